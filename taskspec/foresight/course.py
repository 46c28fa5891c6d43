"""Planned motions of a stage: the way of each axis against time, as far as the text tells it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np

from taskspec.geometry.axis import Axis
from taskspec.motion.path import PathShape
from taskspec.motion.profile import RISE_TIME
from taskspec.program.context import Context
from taskspec.program.execution.tracks import MOVE_SPEED
from taskspec.program.known import known_value
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import Course, Way
from taskspec.spec import AxisEntry, Stage

Coordinates = Callable[[float], dict[Axis, float]]


def moving_axes(stage: Stage) -> dict[Axis, AxisEntry]:
    """The axes that a stage's `axes` move."""
    return {a: e for a, e in stage.axes.items() if e.hold is None and not e.has_force}


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
    for axis, entry in moving_axes(stage.spec).items():
        if entry.move is not None:
            kind = "angular" if axis.is_rotation else "linear"
            lasts.append(abs(entry.move) / (entry.speed or MOVE_SPEED[kind]) + RISE_TIME)
            ways[axis] = _ramp(entry.move, lasts[-1])
            continue
        way = _formula(stage.context, entry, start[axis])
        if way is None:
            return None
        ways[axis] = way
    if stage.spec.time is not None:
        lasts = [stage.spec.time]
    if not lasts or not ways:
        return None
    bends = path is not None or any(e.position is not None for e in stage.spec.axes.values())
    return Course(max(lasts), ways, bends)


def _formula(context: Context, entry: AxisEntry, start: float) -> Way | None:
    """Way of an axis whose velocity, or whose position at any time, is known."""
    if entry.velocity is not None:
        rate = known_value(context, entry.velocity)
        return None if rate is None else lambda time: rate * time
    position = entry.position
    begins = None if position is None else known_value(context, position, {"t": 0.0})
    if position is None or begins is None or not math.isfinite(begins):
        return None

    def way(time: float) -> float:
        value = known_value(context, position, {"t": time})
        return math.nan if value is None else value - start

    return way


def _ramp(way: float, duration: float) -> Way:
    return lambda time: way * min(time / duration, 1.0)


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
