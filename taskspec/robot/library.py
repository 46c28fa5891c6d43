"""The built-in robots."""

from __future__ import annotations

from functools import cache, partial
from pathlib import Path
from xml.etree import ElementTree

from taskspec.deferred import mujoco
from taskspec.geometry.axis import AXES, Axis
from taskspec.robot.description import Description, RobotFile, texts, velocity_limits
from taskspec.robot.types import RobotSummary

_MODELS = Path(__file__).parent / "models"
_PLANAR = {"planar2": (Axis.X, Axis.Y), "planar3": (Axis.X, Axis.Y, Axis.RZ)}


def is_builtin(name: str) -> bool:
    """Whether `robot.model` means a built-in robot."""
    return name in {path.stem for path in _MODELS.glob("*.xml")}


@cache
def builtin_names() -> tuple[str, ...]:
    """The names that `robot.model` may say, sorted by number of joints."""
    found = {path.stem: path for path in _MODELS.glob("*.xml")}
    return tuple(sorted(found, key=lambda name: (_joints(found[name]), name)))


def builtin_robots() -> tuple[RobotSummary, ...]:
    """One line about each built-in robot."""
    summaries = []
    for name in builtin_names():
        root = ElementTree.parse(_MODELS / f"{name}.xml").getroot()
        text = {e.get("name"): e.get("data", "") for e in root.iterfind("custom/text")}
        axes = _PLANAR.get(name, AXES)
        joints = _joints(_MODELS / f"{name}.xml")
        summaries.append(RobotSummary(name, text["about"], joints, axes, text["source"]))
    return tuple(summaries)


def read_builtin(name: str) -> RobotFile:
    """The file of the built-in robot `name`, one of `builtin_names()`; it names no other."""
    return RobotFile(name, ((_MODELS / f"{name}.xml").read_bytes(),), partial(_describe, name))


@cache
def _describe(name: str) -> Description:
    m = mujoco.MjSpec.from_file(str(_MODELS / f"{name}.xml")).compile()
    return Description(name, m, texts(m)["source"], velocity_limits(m))


def _joints(path: Path) -> int:
    return len(ElementTree.parse(path).getroot().findall(".//body/joint"))
