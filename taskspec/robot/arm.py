"""The arm of a robot's file as numbers and words, cached by its content."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import json
import os
import platform
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.robot.coupling import JointCoupling
from taskspec.robot.links import Links
from taskspec.robot.pinocchio_model import Bodies
from taskspec.robot.types import FileRemark, ToolBody, ToolGeometry
from taskspec.shapes import tool_shapes
from taskspec.store import Store, sources

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

_PACKAGE = Path(__file__).resolve().parents[1]
#: Whose text an arm follows from: its own package, and what tools are made of.
_MAKERS = ("robot", "shapes", "geometry")


@dataclass(frozen=True, slots=True, eq=False)
class KnownArm:
    """All of a `RobotModel` but the libraries' own objects; see there.

    Attributes:
        bodies: What Pinocchio's model is rebuilt from; its joints are those of `coupling`.
        tip_number: MuJoCo's number of the body `tip_body`.
    """

    name: str
    bodies: Bodies
    coupling: JointCoupling
    carried_links: tuple[str, ...]
    axes: tuple[Axis, ...]
    home: Array
    lower: Array
    upper: Array
    velocity_limit: Array
    torque_limit: Array
    tool: ToolGeometry
    tool_geoms: tuple[str, ...]
    tip_body: str
    tip_number: int
    tool_body: ToolBody
    links: Links
    source: str
    flange: str
    notes: tuple[str, ...]
    remarks: tuple[FileRemark, ...]


def arm_key(name: str, section: object, content: Sequence[bytes]) -> str:
    """The inputs of an arm, as a key of `known_arms`.

    Args:
        name: The built-in name, or the stem of the file.
        section: The task file's `robot`, with a complete `repr`.
        content: Of the robot's files.
    """
    parts = [hashlib.sha256(part).hexdigest() for part in content]
    return "\n".join((_makers(), name, repr(section), *parts))


def known_arm(key: str) -> KnownArm | None:
    """The arm that is kept under a key; None where there is none."""
    data = _store().get(key)
    if data is None:
        return None
    try:
        found = _read(json.loads(data))
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
        # What cannot be read is made anew; it is nothing that this version has written.
        return None
    return found if isinstance(found, KnownArm) else None


def keep_arm(key: str, arm: KnownArm) -> None:
    """Keeps an arm under a key."""
    _store().put(key, json.dumps(_written(arm)).encode())


#: What an arm is made of: nothing else is made of what is kept, which is data and no program.
_KINDS = {
    kind.__name__: kind
    for kind in (
        *(KnownArm, Bodies, JointCoupling, ToolGeometry, ToolBody, Links, FileRemark),
        *tool_shapes().values(),
    )
}
_KIND, _ARRAY, _AXIS = "kind", "array", "axis"


def _written(value: object) -> Any:
    """A part of an arm as JSON; arrays bit by bit."""
    if isinstance(value, np.ndarray):
        data = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode()
        return {_ARRAY: data, "type": value.dtype.str, "shape": value.shape}
    if isinstance(value, Axis):
        return {_AXIS: str(value)}
    if isinstance(value, tuple | list):
        return [_written(each) for each in value]
    if dataclasses.is_dataclass(value):
        own = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return {_KIND: type(value).__name__, **{n: _written(each) for n, each in own.items()}}
    return value.item() if isinstance(value, np.generic) else value


def _read(data: Any) -> Any:
    """A part of an arm of its JSON; all lists are tuples."""
    if isinstance(data, list):
        return tuple(map(_read, data))
    if not isinstance(data, dict):
        return data
    if _ARRAY in data:
        values = np.frombuffer(base64.b64decode(data[_ARRAY]), np.dtype(data["type"]))
        return values.reshape(data["shape"]).copy()
    if _AXIS in data:
        return Axis(data[_AXIS])
    fields = {name: _read(value) for name, value in data.items() if name != _KIND}
    return _KINDS[data[_KIND]](**fields)


def _store() -> Store:
    return Store.named("robots")


@cache
def _makers() -> str:
    """Programs and processor that an arm's last digits follow from."""
    numpy = import_module("numpy._core._multiarray_umath")
    features = getattr(numpy, "__cpu_features__", {})
    return " ".join(
        (
            sources(*(_PACKAGE / folder for folder in _MAKERS)),
            _mujoco(),
            f"pinocchio {pin.__version__} numpy {np.__version__}",
            f"python {platform.python_version()} {platform.system()} {platform.machine()}",
            *sorted(name for name, there in features.items() if there),
        )
    )


def _mujoco() -> str:
    """MuJoCo as it is installed, without loading it: its files by name, size and time."""
    found = find_spec("mujoco")
    if found is None or found.origin is None:
        # Then nothing is compiled, and nothing was.
        return "no mujoco"
    entries = [
        (entry.name, entry.stat().st_size, entry.stat().st_mtime_ns)
        for entry in os.scandir(Path(found.origin).parent)
        if entry.is_file()
    ]
    return repr(sorted(entries))
