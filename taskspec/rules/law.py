"""What a stage asks of its law that the law, or the arm under it, cannot do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from taskspec.control.representation import Representation
from taskspec.geometry.axis import AXES
from taskspec.program.plan import StagePlan
from taskspec.program.reference.orientation import NEAREST, angles_of, representation_of
from taskspec.program.stages.null_space import bounded
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.spec import FILE, KeyPath, key_of
from taskspec.text.units import show

_ROTATIONS = AXES[3:]


@rule("TS214", "a limit that nothing keeps", phase=Phase.AXES)
def unkept_limits(stage: StagePlan) -> Iterator[Finding]:
    """A limit on the torques' rate in a stage whose torques are a closed form's, or a servo's."""
    task = stage.context.loaded.task
    torques = task.robot.takes_torques
    if (torques and stage.law.solve == "qp") or task.limits_of(stage.spec).torque_rate is None:
        return
    own = stage.spec.limits is not None and stage.spec.limits.torque_rate is not None
    owner = FILE.stages[stage.name].limits if own else FILE.limits
    if torques:
        why = f"in stage {stage.name!r}: its torques are those of a closed form"
        hint = "solve the law by a program that keeps it, as in 'law: {kind: hybrid, solve: qp}'"
    else:
        why = f"of a robot that takes {task.robot.commands}: its torques are those of its servo"
        hint = "limit the servo's reference: robot: {servo: {acceleration: .., jerk: ..}}"
    yield error(
        "TS214",
        f"nothing keeps 'torque_rate' {why}",
        key_of(owner.torque_rate),
        hint,
        unless=("TS214",),  # The file's limits are those of several stages.
    )


@rule("TS234", "an arm whose weight nothing bears")
def unborne_weight(stage: StagePlan) -> Iterator[Finding]:
    """Gravity under a law that leaves it to a counterweight, on an arm without one.

    The springs bear the part J^T K e of it, with the deflection e = K^-1 F of least |J^T F - g|.
    """
    context = stage.context
    gravity = context.start_gravity
    if not stage.falls:
        return
    both = np.kron(np.eye(2), stage.rotation.T)
    rows = [AXES.index(a) for a in stage.axes]
    J = (both @ context.start_jacobian)[rows]
    wrench = np.linalg.lstsq(J.T, gravity, rcond=None)[0]
    weight = sum(w**2 for w, a in zip(wrench, stage.axes, strict=True) if not a.is_rotation) ** 0.5
    yield error(
        "TS234",
        f"nothing bears the weight of the arm under {stage.law.kind!r}: that is "
        f"{show(weight, 'N', 2)} at the tool, and the arm falls",
        _law_of(stage),
        "write 'balanced: true' under 'robot' if a counterweight does, or take a law that "
        "compensates gravity, such as pd",
        unless=("TS234",),
    )


@rule("TS233", "a goal in the null space that has no effect on this arm", phase=Phase.AXES)
def idle_goals(stage: StagePlan) -> Iterator[Finding]:
    """Goals in the null space of an arm that has none, or nothing for them to do."""
    robot, law = stage.context.robot, stage.law
    if "null_space" not in law.model_fields_set:
        return
    n, place = robot.n, _law_of(stage).null_space
    if n == len(stage.axes):
        yield warning(
            "TS233",
            f"{robot.name!r} has no null space: its {n} joints all serve {', '.join(stage.axes)}",
            place,
            "leave it out, or take an arm with more joints",
        )
    elif "joint-limits" in law.null_space and not bounded(robot):
        message = f"no joint of {robot.name!r} has limits to keep away from"
        yield warning("TS233", message, place)


@rule(
    {
        "TS228": "Euler angles where the task frame turns or a rotation is not held to a motion",
        "TS229": "Euler angles at their singularity at the start",
    },
    phase=Phase.AXES,
)
def euler_angles(stage: StagePlan) -> Iterator[Finding]:
    """Euler angles that a stage cannot have, or that are singular at the start."""
    representation = representation_of(stage.law)
    if representation is None:
        return
    place, angles = _law_of(stage).orientation, stage.law.orientation
    once = ("TS228", "TS229")  # One law of several stages is one mistake.
    reason = _why_not(stage)
    if reason is not None:
        yield error(
            "TS228",
            f"stage {stage.name!r} cannot use {angles} angles: {reason}",
            place,
            "'orientation: so3' has no such limit",
            unless=once,
        )
        return
    R = stage.rotation.T @ stage.context.start_R
    if _distance(representation, R) < NEAREST:
        yield error(
            "TS229",
            f"{angles} angles are singular where stage {stage.name!r} would begin: at the start "
            f"{_described(representation, R)}",
            place,
            "keep 1 deg away; " + _OTHERS[representation.name],
            unless=once,
        )


def _law_of(stage: StagePlan) -> KeyPath:
    """The path of the law that a stage has, its own or the file's."""
    return FILE.law if stage.spec.law is None else FILE.stages[stage.name].law


def _why_not(stage: StagePlan) -> str | None:
    """Why the tool has no Euler angles that a law could control; None if it has."""
    robot = stage.context.robot
    rotations = [a for a in _ROTATIONS if a in stage.axes]
    if not rotations:
        return f"{robot.name!r} does not turn its tool"
    if len(rotations) < len(_ROTATIONS):
        return f"{robot.name!r} turns its tool about {', '.join(rotations)} only"
    if _turns(stage):
        return f"frame {stage.frame.name!r} turns, and the angles are those in a frame at rest"
    for axis in rotations:
        if axis in stage.spec.axes and stage.spec.axes[axis].has_force:
            return f"{axis!r} has a torque, and a moment is about an axis of the frame"
    return None


def _turns(stage: StagePlan) -> bool:
    """Whether the axes of a stage's frame change while the robot works."""
    frame = stage.frame
    shape = stage.context.loaded.task.shapes.get(frame.surface_name or frame.owner)
    if shape is not None and shape.motion is not None and {*shape.motion.axes} & {*_ROTATIONS}:
        return True
    if frame.kind == "following":
        assert frame.surface is not None
        return not frame.surface.flat
    return not frame.still


def _distance(representation: Representation, R: NDArray[np.float64]) -> float:
    """Angle [rad] of an orientation (3, 3) from the nearest singular one."""
    middle = abs(float(angles_of(representation, R)[1]))
    return abs(np.pi / 2 - middle) if representation.name == "rpy" else min(middle, np.pi - middle)


def _described(representation: Representation, R: NDArray[np.float64]) -> str:
    angle = np.rad2deg(angles_of(representation, R)[1])
    return f"{representation.names[1]} is {angle:.3g} deg"


_OTHERS = {
    "rpy": "'orientation: zyz' is singular elsewhere, where the tool points along the frame's z, "
    "'so3' nowhere",
    "zyz": "'orientation: rpy' is singular elsewhere, at +-90 deg of pitch, 'so3' nowhere",
}
