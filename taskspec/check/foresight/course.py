"""Planned motions of a stage: the way of each axis against time, as far as the text tells it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from taskspec.check.foresight.known import known_value
from taskspec.geometry.axis import Axis
from taskspec.motion.path import PathShape
from taskspec.motion.profile import RISE_TIME
from taskspec.program.context import Context
from taskspec.program.execution.tracks import MOVE_SPEED
from taskspec.spec import AxisEntry, Stage

Way = Callable[[float], float]
Coordinates = Callable[[float], dict[Axis, float]]


@dataclass(frozen=True, slots=True)
class Course:
    """A planned motion.

    Attributes:
        duration: until its path or its time ends it [s].
        ways: displacement of each axis against time [m, rad].
        bends: whether its velocity changes on the way.
    """

    duration: float
    ways: Mapping[Axis, Way]
    bends: bool

    def moved(self, time: float) -> dict[Axis, float]:
        """Displacement along and about each axis since the stage began."""
        return {axis: way(time) for axis, way in self.ways.items()}


def moving_axes(stage: Stage) -> dict[Axis, AxisEntry]:
    """The axes that a stage's `axes` move."""
    return {a: e for a, e in stage.axes.items() if e.hold is None and not e.has_force}


def course_of(
    context: Context, stage: Stage, start: Mapping[Axis, float], path: PathShape | None
) -> Course | None:
    """How a stage moves; None where that is not planned, or nothing says how long it lasts.

    Args:
        context: the task. stage: the stage. start: coordinates of the tip in its frame as it
            begins [m, rad]. path: its path.
    """
    ways: dict[Axis, Way] = {}
    lasts = []
    if path is not None:
        duration, coordinates = _timed(path, start)
        lasts.append(duration)
        ways |= {a: _on_path(coordinates, a, duration, start[a]) for a in path.axes}
    for axis, entry in moving_axes(stage).items():
        if entry.move is not None:
            kind = "angular" if axis.is_rotation else "linear"
            lasts.append(abs(entry.move) / (entry.speed or MOVE_SPEED[kind]) + RISE_TIME)
            ways[axis] = _ramp(entry.move, lasts[-1])
            continue
        way = _formula(context, entry, start[axis])
        if way is None:
            return None
        ways[axis] = way
    if stage.time is not None:
        lasts = [stage.time]
    if not lasts or not ways:
        return None
    bends = path is not None or any(e.position is not None for e in stage.axes.values())
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
