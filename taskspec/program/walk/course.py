"""Planned motions of a stage: how each axis moves, and until when."""

from __future__ import annotations

from collections.abc import Mapping

from taskspec.geometry.axis import Axis
from taskspec.modes import AxisMode
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import Course
from taskspec.program.walk.reference_motion import reference_motion
from taskspec.spec import Stage


def moving_axes(stage: Stage) -> dict[Axis, AxisMode]:
    """The axes that a stage's `axes` move, with their modes."""
    free = {a: entry.mode for a, entry in stage.axes.items() if not entry.has_force}
    return {a: mode for a, mode in free.items() if mode.moves}


def course_of(
    stage: StagePlan, start: Mapping[Axis, float], rates: Mapping[Axis, float]
) -> Course | None:
    """The motion of a stage; None where it is not planned, or its duration is unknown.

    Args:
        stage: the stage.
        start: coordinates of the tip in its frame as it starts [m, rad].
        rates: of the reference that is handed over [m/s, rad/s]; none for rest.
    """
    if not all(mode.leads for mode in moving_axes(stage.spec).values()):
        return None
    motion = reference_motion(stage, start, rates)
    if motion is None or motion.lasts is None or not motion.displacements:
        return None
    bends = stage.path is not None or any(e.mode.bends for e in stage.spec.axes.values())
    return Course(motion.lasts, motion.displacements, bends)
