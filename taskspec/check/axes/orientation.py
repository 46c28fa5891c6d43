"""Laws in Euler angles: where these do not exist, and where they are singular."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.control.representation import Representation
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.context import Context
from taskspec.program.reference.orientation import NEAREST, angles_of, representation_of
from taskspec.program.world.frames import FrameModel
from taskspec.spec import FILE
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics

register(
    {
        "TS228": "Euler angles where the task frame turns or a rotation is not held to a motion",
        "TS229": "Euler angles at their singularity at the start",
    }
)

_ROTATIONS = AXES[3:]
_WAY_OUT = "'orientation: so3' has no such limit"


def check_orientation(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: NDArray[np.float64],
    found: Diagnostics,
) -> None:
    """Reports Euler angles that stage `name` cannot have, or that are singular at the start.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose. found: where findings go.
    """
    stage = context.loaded.task.stages[name]
    law = context.law_of(stage)
    representation = representation_of(law)
    if representation is None:
        return
    owner = FILE.stages[name].law if stage.law is not None else FILE.law
    place = context.loaded.span(owner.orientation)
    if found.says("TS228", place) or found.says("TS229", place):
        return  # One law of several stages is one mistake.
    reason = _why_not(context, name, axes)
    if reason is not None:
        message = f"stage {name!r} cannot use {law.orientation} angles: {reason}"
        found.error("TS228", message, place, _WAY_OUT)
        return
    away = _distance(representation, rotation.T @ context.start_R)
    if away < NEAREST:
        found.error(
            "TS229",
            f"{law.orientation} angles are singular where stage {name!r} would begin: at the start "
            f"{_described(representation, rotation.T @ context.start_R)}",
            place,
            "keep 1 deg away; " + _OTHERS[representation.name],
        )


def _why_not(context: Context, name: str, axes: tuple[Axis, ...]) -> str | None:
    """Why the tool has no Euler angles that a law could control; None if it has."""
    stage = context.loaded.task.stages[name]
    frame = context.frame_of(stage)
    rotations = [a for a in _ROTATIONS if a in axes]
    if not rotations:
        return f"{context.robot.name!r} does not turn its tool"
    if len(rotations) < len(_ROTATIONS):
        return f"{context.robot.name!r} turns its tool about {', '.join(rotations)} only"
    if _turns(context, frame):
        return f"frame {frame.name!r} turns, and the angles are those in a frame at rest"
    for axis in rotations:
        if axis in stage.axes and stage.axes[axis].has_force:
            return f"{axis!r} has a torque, and a moment is about an axis of the frame"
    return None


def _turns(context: Context, frame: FrameModel) -> bool:
    """Whether a frame's axes change while the robot works."""
    shape = context.loaded.task.shapes.get(frame.surface_name or frame.owner)
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
