"""`taskspec robots`: the arms that come along, and those that pip has installed."""

from __future__ import annotations

from itertools import groupby


def list_robots() -> int:
    """Prints the built-in robots, and what `PACKAGE:NAME` finds in installed packages."""
    from rich.text import Text

    from taskspec.robot import builtin_robots
    from taskspec.robot.packages import packaged_robots
    from taskspec.spec.robot_file import built_in
    from taskspec_runner.cli.console import show, table

    made = table(
        *("robot", "joints", "axes of the tip", "protection", "servos", "about", "figures from"),
        indent=0,
    )
    protections, servos = built_in("protection"), built_in("servo")
    for robot in builtin_robots():
        axes, own = " ".join(robot.axes), robot.name if robot.name in protections else "none"
        follows = [name for name in servos if name.partition("-")[0] == robot.name]
        text = ", ".join(follows) or "none"
        cells = (robot.name, str(robot.joints), axes, own, text, robot.about, robot.source)
        made.add_row(*map(Text, cells))
    show(made)
    installed = table("package", "robots, as PACKAGE:NAME", indent=0)
    for package, robots in groupby(packaged_robots(), key=lambda robot: robot.package):
        names = dict.fromkeys(robot.name for robot in robots)
        installed.add_row(Text(package), Text(", ".join(names)))
    if installed.row_count:
        show("", installed)
    return 0
