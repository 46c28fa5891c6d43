"""Planned motions of a stage: the way of each axis against time, as far as the text tells it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from taskspec.geometry.axis import Axis
from taskspec.modes import AxisMode, Way
from taskspec.motion.path import PathShape
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import Course
from taskspec.spec import Stage

Coordinates = Callable[[float], dict[Axis, float]]


def moving_axes(stage: Stage) -> dict[Axis, AxisMode]:
    """The axes that a stage's `axes` move, with their modes."""
    free = {a: entry.mode for a, entry in stage.axes.items() if not entry.has_force}
    return {a: mode for a, mode in free.items() if mode.moves}


def course_of(stage: StagePlan, start: Mapping[Axis, float]) -> Course | None:
    """How a stage moves; None where that is not planned, or nothing says how long it lasts.

    Args:
        stage: the stage.
        start: coordinates of the tip in its frame as it starts [m, rad].
    """
    ways: dict[Axis, Way] = {}
    lasts = []
    path = stage.path
    if path is not None:
        duration, coordinates = _timed(path, start)
        lasts.append(duration)
        ways |= {a: _on_path(coordinates, a, duration, start[a]) for a in path.axes}
    for axis, mode in moving_axes(stage.spec).items():
        way = mode.way(stage.known, start[axis])
        if way is None:
            return None
        ways[axis] = way
        if mode.lasts is not None:
            lasts.append(mode.lasts)
    if stage.spec.time is not None:
        lasts = [stage.spec.time]
    if not lasts or not ways:
        return None
    bends = path is not None or any(e.mode.bends for e in stage.spec.axes.values())
    return Course(max(lasts), ways, bends)


def _on_path(coordinates: Coordinates, axis: Axis, duration: float, start: float) -> Way:
    return lambda time: coordinates(min(time, duration))[axis] - start


def _timed(path: PathShape, start: Mapping[Axis, float]) -> tuple[float, Coordinates]:
    """Duration [s] of a path, and its coordinates at a time; a table is taken as a polygon."""
    if path.table is None:
        plan = path.plan(start)

        def on_curve(time: float) -> dict[Axis, float]:
            curve = path.curve(plan.timing(time), start, {})
            return {a: float(value) for a, value in curve.items()}

        return plan.duration, on_curve
    table = path.table
    along = table.argument()
    duration = path.time or table.length / (path.speed or math.inf)
    if table.time is not None:
        duration = float(table.time[-1] - table.time[0])

    def on_polygon(time: float) -> dict[Axis, float]:
        at = along[0] + (along[-1] - along[0]) * time / duration
        return {a: float(np.interp(at, along, table.points[a])) for a in path.axes}

    return duration, on_polygon
