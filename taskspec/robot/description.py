"""A robot's file as compiled by MuJoCo, before anything is taken from it."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field
from typing import TYPE_CHECKING

import numpy as np

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.errors import RobotError
from taskspec.robot.inertias import Unphysical
from taskspec.robot.urdf_limits import LockedJoint

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

BOUND_MASS = 1e-9
"""Mass [kg] that stands for none, since MuJoCo compiles no moving body without."""

BOUND_INERTIA = 1e-12
"""Inertia [kg·m²] that goes with `BOUND_MASS`."""


@dataclass(frozen=True, slots=True)
class Description:
    """The content of a robot's file.

    Attributes:
        name: The built-in name, or the stem of the file.
        model: The file as it is, compiled.
        source: Where the numbers come from.
        velocity: Velocity limits by joint id [rad/s or m/s].
        locked: Joints whose limits are one value, by joint id.
        coupled: Joints that follow another one or that another one follows, as a gripper's fingers
            do.
        constraints: The model's equality constraints in words, with file and line where known.
        untied: Joints that are to follow what is no joint, by id: what that is, in words.
        notes: What could not be read as it is written.
        unphysical: Links whose inertia no body has; `model` has another one.
    """

    name: str
    model: mujoco.MjModel
    source: str
    velocity: Mapping[int, float] = field(default_factory=dict)
    locked: Mapping[int, LockedJoint] = field(default_factory=dict)
    coupled: tuple[str, ...] = ()
    constraints: Mapping[int, str] = field(default_factory=dict)
    untied: Mapping[int, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    unphysical: tuple[Unphysical, ...] = ()


@dataclass(frozen=True, slots=True)
class RobotFile:
    """A robot's file, read but not yet compiled.

    Attributes:
        name: The built-in name, or the stem of the file.
        content: All that its description follows from; None where that is not known before
            MuJoCo has read it.
        describe: Compiles it.
    """

    name: str
    content: tuple[bytes, ...] | None
    describe: Callable[[], Description]


@contextmanager
def listening(heard: list[str]) -> Iterator[None]:
    """Collects MuJoCo's warnings, some of which would go to a log file in the working directory."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(heard.append)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield
        heard.extend(str(warning.message).partition(" Time = ")[0] for warning in caught)
    finally:
        mujoco.set_mju_user_warning(before)


def texts(m: mujoco.MjModel) -> dict[str, str]:
    """The `<custom><text>` elements of a model, by name."""
    found = {}
    for i in range(m.ntext):
        start = m.text_adr[i]
        data = bytes(m.text_data[start : start + m.text_size[i] - 1])
        found[mujoco.mj_id2name(m, mujoco.mjtObj.mjOBJ_TEXT, i)] = data.decode()
    return found


def velocity_limits(m: mujoco.MjModel) -> dict[int, float]:
    """The velocity limits of `<custom><numeric name="velocity_limit">`, by joint id.

    Raises:
        RobotError: TS405 when there are more or fewer values than joints.
    """
    i = mujoco.mj_name2id(m, mujoco.mjtObj.mjOBJ_NUMERIC, "velocity_limit")
    if i < 0:
        return {}
    start = m.numeric_adr[i]
    data = m.numeric_data[start : start + m.numeric_size[i]]
    if len(data) != m.njnt:
        raise RobotError(
            "TS405",
            f"velocity_limit has {len(data)} values, the file has {m.njnt} joints",
            "give one for every joint, in the file's order, in rad/s or m/s",
        )
    return {j: float(limit) for j, limit in enumerate(data) if limit > 0}


def driven_joints(m: mujoco.MjModel) -> frozenset[int]:
    """The joints on which an actuator acts."""
    return frozenset(
        int(m.actuator_trnid[i, 0])
        for i in range(m.nu)
        if m.actuator_trntype[i] in _on_joints() and m.actuator_gear[i, 0]
    )


def _on_joints() -> tuple[int, int]:
    """The transmissions by which an actuator acts on a joint."""
    return int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT)


def torque_limit(m: mujoco.MjModel, joint: int) -> float:
    """The largest torque or force that the file allows on a joint [N·m or N]."""
    limit = float(np.abs(m.jnt_actfrcrange[joint]).min()) if m.jnt_actfrclimited[joint] else np.inf
    for i in range(m.nu):
        on_joint = m.actuator_trntype[i] in _on_joints() and m.actuator_trnid[i, 0] == joint
        gear = abs(float(m.actuator_gear[i, 0]))
        if not on_joint or gear == 0:
            continue
        if m.actuator_forcelimited[i]:
            limit = min(limit, gear * float(np.abs(m.actuator_forcerange[i]).min()))
        motor = m.actuator_biastype[i] == mujoco.mjtBias.mjBIAS_NONE
        if motor and m.actuator_ctrllimited[i]:
            gain = gear * abs(float(m.actuator_gainprm[i, 0]))
            limit = min(limit, gain * float(np.abs(m.actuator_ctrlrange[i]).min()))
    return limit if limit > 0 else np.inf
