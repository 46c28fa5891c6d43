"""Holds the model terms of robots that nobody here wrote against Pinocchio.

    python campaigns/foreign_robots.py --packages runs/foreign

The packages of `foreign_robots.yaml` lie in that folder; `make foreign` puts them there. A robot
that cannot be loaded is an error, unless its file has no masses.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import yaml

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from taskspec.robot import RobotError, RobotModel, load_robot
from taskspec.robot.rigid_body import RigidBody
from term_differences import TOLERANCE, differences

ROOT = Path(__file__).resolve().parents[1]
LIST = Path(__file__).with_suffix(".yaml")
STATES = 50
_BASE = SimpleNamespace(xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0))
_TOOL = SimpleNamespace(
    shape="sphere",
    radius=None,
    size=None,
    thickness=None,
    length=None,
    mass=0.3,
    com=None,
    inertia=None,
)


def packages() -> dict[str, Any]:
    """The list: what pip installs, and which robots are in it."""
    listed: dict[str, Any] = yaml.safe_load(LIST.read_text("utf-8"))
    return listed


def robots(folder: Path) -> dict[str, RobotModel | RobotError]:
    """The listed robots by name, or why one cannot be loaded; packages lie in `folder`."""
    loaded: dict[str, RobotModel | RobotError] = {}
    for package in packages().values():
        root = folder / package["root"]
        for name, robot in package["robots"].items():
            if robot.get("weightless"):
                continue
            try:
                loaded[name] = load_listed(root, robot)
            except RobotError as error:
                loaded[name] = error
    return loaded


def load_listed(root: Path, robot: dict[str, Any]) -> RobotModel:
    """A listed robot of the package whose files lie in `root`.

    Raises:
        RobotError: it cannot be loaded.
    """
    return load_robot(_section(robot["file"], robot.get("flange")), root)


def _section(file: str, flange: str | None = None) -> Any:
    mount = flange and SimpleNamespace(body=flange, xyz=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0))
    return SimpleNamespace(model=file, flange=mount, base=_BASE, tool=_TOOL, balanced=False)


def _say(*lines: str) -> None:
    sys.stdout.write("".join(f"{line}\n" for line in lines))


def main(arguments: list[str] | None = None) -> int:
    """Prints a line for each robot; 1 where one disagrees or cannot be loaded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--packages", type=Path, default=ROOT / "runs" / "foreign")
    parser.add_argument("--names", action="store_true", help="print what pip is to install")
    options = parser.parse_args(arguments)
    if options.names:
        _say(*packages())
        return 0
    folder, failed = options.packages.resolve(), 0
    sys.path.append(str(folder))
    _say(f"{'robot':12} joints instructions  largest difference")
    for name, robot in robots(folder).items():
        if isinstance(robot, RobotError):
            _say(f"{name:12} {robot.code} {robot.message}")
            failed += 1
            continue
        found = differences(robot, 1, STATES)
        worst = max(found, key=lambda term: found[term])
        size = RigidBody(robot).function.n_instructions()
        _say(f"{name:12} {robot.pin.nv:6} {size:12}  {found[worst]:.1e} of {worst}")
        failed += found[worst] >= TOLERANCE
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
