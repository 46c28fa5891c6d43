"""Robots of packages that pip has installed: found by `PACKAGE:NAME` among their files."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from taskspec.deferred_methods import dataclass
from taskspec.robot.errors import RobotError
from taskspec.text.suggest import suggestion

_NAMED = re.compile(r"([A-Za-z0-9][A-Za-z0-9._-]+):(?!//)([^:]+)\Z")
#: What files are called that have their robot's name from a folder.
_PLAIN = frozenset({"robot", "scene", "model", "arm", "urdf", "mjcf", "xml", "robots"})
_ENDINGS = (".urdf.xacro", ".xacro", ".urdf", ".xml", ".mjcf")
_JOINT = re.compile(rb"<joint\b")
_ROOT = re.compile(rb"<(robot|mujoco)\b")
_LARGEST_FILE = 8 * 2**20
_FEWEST_JOINTS = 2


@dataclass(frozen=True, slots=True)
class Packaged:
    """A robot's file in an installed package.

    Attributes:
        package: As pip knows it.
        name: Of the robot in it.
        path: Of the file.
        folder: Below which the files of the package lie.
    """

    package: str
    name: str
    path: Path
    folder: Path


def is_packaged(model: str) -> bool:
    """Whether `robot.model` means a robot of an installed package."""
    return _NAMED.match(model) is not None


def find_packaged(model: str) -> Packaged:
    """The file of a robot that is given as `PACKAGE:NAME`; NAME may be the end of a path.

    Raises:
        RobotError: TS401 when the package is not installed, or has no such robot or several.
    """
    match = _NAMED.match(model)
    assert match is not None
    package, name = match.groups()
    robots = _robots(package)
    if robots is None:
        raise RobotError(
            "TS401",
            f"no package '{package}' is installed that '{model}' could come from",
            f"install it: pip install {package}; `taskspec robots` lists what there is",
        )
    exact = [robot for robot in robots if robot.name == name]
    found = exact or [r for r in robots if r.path.as_posix().endswith(f"/{name.lstrip('/')}")]
    if len(found) == 1:
        return found[0]
    if found:
        ends = ", ".join(f"{package}:{_end(robot)}" for robot in found[:6])
        raise RobotError(
            "TS401",
            f"'{package}' has {len(found)} robots '{name}'",
            f"say which by the end of its path: {ends}",
        )
    raise RobotError(
        "TS401",
        f"'{package}' has no robot '{name}'",
        suggestion(name, dict.fromkeys(robot.name for robot in robots), "robots")
        or "it has no description of a robot that could be read",
    )


def packaged_robots() -> Iterator[Packaged]:
    """All robots of all installed packages, by package and name."""
    names = {d.name for d in metadata.distributions() if d.name is not None}
    for package in sorted(names, key=str.lower):
        robots = _robots(package) or ()
        yield from sorted(robots, key=lambda robot: (robot.name, robot.path))


def _end(robot: Packaged) -> str:
    return robot.path.relative_to(robot.folder).as_posix()


@lru_cache(maxsize=256)
def _robots(package: str) -> tuple[Packaged, ...] | None:
    """The robots of a package; None where it is not installed."""
    try:
        distribution = metadata.distribution(package)
    except (metadata.PackageNotFoundError, ValueError):
        return None
    found: dict[Path, Packaged] = {}
    for file in distribution.files or ():
        if not file.name.endswith(_ENDINGS) or "test" in str(file):
            continue
        path = Path(str(distribution.locate_file(file))).resolve()
        if not _is_robot(path):
            continue
        # What cmeel has built lies below a prefix of its own, as on a system.
        parts = file.parts
        depth = 3 if parts[0] == "cmeel.prefix" else 1
        folder = Path(*path.parts[: len(path.parts) - len(parts) + depth])
        found[path] = Packaged(package, _name(path), path, folder)
    expanded = {path.with_suffix("") for path in found if path.suffix == ".urdf"}
    return tuple(
        robot
        for path, robot in found.items()
        if path.suffix != ".xacro" or path.parent / path.name.partition(".")[0] not in expanded
    )


def _name(path: Path) -> str:
    """The file's name without its ending and `_robot`, or that of the folder that says more."""
    stem = next(path.name.removesuffix(end) for end in _ENDINGS if path.name.endswith(end))
    stem = stem.removesuffix("_robot")
    folders = (folder.name.removesuffix("_description") for folder in path.parents)
    return stem if stem not in _PLAIN else next((f for f in folders if f not in _PLAIN), stem)


def _is_robot(path: Path) -> bool:
    """Whether a file describes something with joints; those that others include do not."""
    try:
        if path.stat().st_size > _LARGEST_FILE:
            return False
        data = path.read_bytes()
    except OSError:
        return False
    root = _ROOT.search(data)
    if root is None:
        return False
    if path.suffix == ".xacro":
        part = path.name.partition(".")[0].endswith("_macro")
        return not part and (b"<joint" in data or b"xacro:include" in data)
    return len(_JOINT.findall(data)) >= _FEWEST_JOINTS
