"""`taskspec robots`: the arms that come along."""

from __future__ import annotations


def list_robots() -> int:
    """Prints the built-in robots."""
    from rich.text import Text

    from taskspec.robot import builtin_robots
    from taskspec_runner.cli.console import show, table

    made = table("robot", "joints", "axes of the tip", "about", "figures from", indent=0)
    for robot in builtin_robots():
        cells = (robot.name, str(robot.joints), " ".join(robot.axes), robot.about, robot.source)
        made.add_row(*map(Text, cells))
    show(made)
    return 0
