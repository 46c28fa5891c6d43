"""Directions of the world in which an arm can move its tip."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from taskspec.deferred import mujoco
from taskspec.geometry.axis import AXES, Axis
from taskspec.robot.chain import Chain
from taskspec.robot.errors import RobotError
from taskspec.robot.twin import Twin
from taskspec.text.codes import register

register({"TS408": "a tool tip that cannot move along the world's axes"})

if TYPE_CHECKING:
    import numpy.typing as npt

    Array = npt.NDArray[np.float64]

_SAMPLES = 5
_ZERO = 1e-9
_RANK = 1e-6


def tip_axes(twin: Twin) -> tuple[Axis, ...]:
    """The world axes along and about which the tip can move independently.

    Those are the rows of the tip's Jacobian that are not identically zero; where an arm has fewer
    joints than such rows, its translations alone.

    Args:
        twin: The arm, in the pose of its base.

    Returns:
        Names out of `x y z rx ry rz`, in this order.

    Raises:
        RobotError: TS408 when even the translations are not independent.
    """
    rows = np.zeros(6, dtype=bool)
    rank = np.zeros(2, dtype=int)
    rng = np.random.default_rng(0)
    samples = [twin.resolved_jacobian(rng.uniform(-1.5, 1.5, twin.n)) for _ in range(_SAMPLES)]
    for J in samples:
        rows |= np.abs(J).max(axis=1) > _ZERO
    for J in samples:
        every, linear = J[rows], J[:3][rows[:3]]
        rank = np.maximum(rank, [_rank(every), _rank(linear)])
    if rank[0] == rows.sum():
        return tuple(axis for axis, exists in zip(AXES, rows, strict=True) if exists)
    if rank[1] == rows[:3].sum() and rank[1] > 0:
        return tuple(axis for axis, exists in zip(AXES[:3], rows[:3], strict=True) if exists)
    moved = ", ".join(axis for axis, exists in zip(AXES[:3], rows[:3], strict=True) if exists)
    raise RobotError(
        "TS408",
        f"the arm's {twin.n} joints cannot move the tip along the world's {moved} one by one",
        "turn `base` so that the arm's plane is one of the world's coordinate planes; where the "
        "file does not say how long the last link is, name a `flange` at its end",
        ("base",),
    )


def _rank(J: Array) -> int:
    return int(np.linalg.matrix_rank(J, tol=_RANK)) if J.size else 0


def is_planar(m: mujoco.MjModel, chain: Chain, at: Array) -> bool:
    """Whether all joints of a chain move it in one plane, hinges among them.

    Args:
        m: The robot's file, compiled.
        chain: The joints.
        at: (nq,) where the others are locked, and any place of these.
    """
    data = mujoco.MjData(m)
    data.qpos[:] = at
    mujoco.mj_kinematics(m, data)
    hinge = m.jnt_type[list(chain.joints)] == mujoco.mjtJoint.mjJNT_HINGE
    axes = data.xaxis[list(chain.joints)]
    turns, slides = axes[hinge], axes[~hinge]
    if not len(turns):
        return False
    normal = turns[0] / np.linalg.norm(turns[0])
    parallel = np.abs(np.cross(turns, normal)).max() < _RANK
    within = not len(slides) or np.abs(slides @ normal).max() < _RANK
    return bool(parallel and within and len(axes) > 1)
