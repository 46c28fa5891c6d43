"""Two runs held against each other: what they came to, and where their logs part."""

from __future__ import annotations

from taskspec_runner.diff.difference import Difference, diff_runs
from taskspec_runner.diff.page import write_difference

__all__ = ["Difference", "diff_runs", "write_difference"]
