"""`follows`: axes that move as a mechanism's geometry couples them to the others.

About the mechanism's axis the tool turns with the angle that the handle's place tells. Along it the
tool goes by the lead for every angle: that which another axis of the stage commands, so that both
move in step, else the one that is measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.program.context import Context
from taskspec.program.layout import Layout
from taskspec.program.reference.axis_reference import AxisReference
from taskspec.program.reference.modes import AxisPlan
from taskspec.program.reference.tracked_mechanism import TrackedMechanism
from taskspec.program.world.frames import FrameModel

_ALIGNED = 1e-6


class UncoupledError(ValueError):
    """Why a mechanism's geometry asks for no motion of an axis; `hint` says what to do."""

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.hint = hint


@dataclass(frozen=True, slots=True)
class Coupling:
    """How one axis follows: `ratio` times the reference of `leader`, else times the angle.

    The ratio is in m/rad or rad/rad; it is 0 where the frame itself turns with the handle.
    """

    ratio: float
    leader: Axis | None


def coupling(
    context: Context,
    frame: FrameModel,
    rotation: NDArray[np.float64],
    plans: Mapping[Axis, AxisPlan],
    name: Axis,
) -> Coupling:
    """How axis `name` follows the mechanism that its entry names.

    Args:
        context: the task. frame: the stage's. rotation: (3, 3) its axes at the start pose.
        plans: of all axes of the stage. name: of the axis.

    Raises:
        UncoupledError: the geometry asks for no motion of this axis, or it is not known.
    """
    followed = plans[name].axis.follows
    assert followed is not None
    mechanism = context.mechanisms[followed]
    if context.held != followed:
        raise UncoupledError(
            f"the robot does not hold {followed!r}, so its angle is not known",
            f"hold it: robot.grasp: {followed}.handle",
        )
    i = AXES.index(name) % 3
    along = float(rotation[:, i] @ mechanism.rotation[:, 2])
    if abs(along) < 1 - _ALIGNED:
        raise UncoupledError(
            f"{name!r} of frame {frame.name!r} is not along the axis of {followed!r}",
            f"take a frame whose axis is that of the mechanism, such as {followed}",
        )
    turns = name.is_rotation
    if turns and not mechanism.swings:
        raise UncoupledError(
            f"the handle of {followed!r} does not go around its axis, so nothing tells an angle "
            "to follow",
            "give the rotation a mode of its own, such as velocity",
        )
    if not turns and mechanism.lead == 0:
        raise UncoupledError(
            f"{followed!r} is a {mechanism.kind}: turning it moves nothing along its axis",
            "write 'hold'",
        )
    if frame.mechanism is not None:
        return Coupling(0.0, None)
    if turns:
        return Coupling(float(np.sign(along)), None)
    leader = Axis(f"r{name}")
    plan = plans.get(leader)
    commanded = plan is not None and plan.motion and not plan.force and plan.mode != "follows"
    if commanded and plan is not None and not plan.axis.is_soft:
        return Coupling(mechanism.lead, leader)
    return Coupling(float(np.sign(along)) * mechanism.lead, None)


def coupled_motion(
    axis: Axis,
    found: Coupling,
    tracked: TrackedMechanism,
    motions: Mapping[Axis, AxisReference],
    parameters: Layout,
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Displacement since the stage's start, rate and acceleration that a coupling asks for.

    A measured angle gives no acceleration.
    """
    if found.leader is None:
        ratio = found.ratio
        return ratio * (tracked.angle - tracked.since), ratio * tracked.rate, ca.SX(0)
    leader = motions[found.leader]
    begin = parameters.add(f"begin.{axis}")
    return (
        found.ratio * (leader.value - begin),
        found.ratio * leader.rate,
        found.ratio * leader.acceleration,
    )
