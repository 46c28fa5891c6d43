"""What can be known before anything moves: findings about a task that its text alone does not show.

Text, names, units and modes are checked while the file is read; here the robot, its start, its
axes and its contacts come in.
"""

from __future__ import annotations

from dataclasses import dataclass

import taskspec.rules.all  # noqa: F401  (it registers the rules)
