"""The arm of a robot's file as numbers and words, cached by its content."""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
from collections.abc import Sequence
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.robot.coupling import JointCoupling
from taskspec.robot.links import Links
from taskspec.robot.pinocchio_model import Bodies
from taskspec.robot.types import FileRemark, ToolBody, ToolGeometry
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
        found = pickle.loads(data)
    except Exception:
        # What cannot be read is made anew; it is nothing that this version has written.
        return None
    return found if isinstance(found, KnownArm) else None


def keep_arm(key: str, arm: KnownArm) -> None:
    """Keeps an arm under a key."""
    _store().put(key, pickle.dumps(arm))


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
