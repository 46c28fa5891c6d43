"""Planned motions of a stage: the way of each axis against time, as far as the text tells it."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import AxisMode, StageStart, Way
from taskspec.motion import blend
from taskspec.motion.path import PathShape
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import Course
from taskspec.spec import Stage

Coordinates = Callable[[float], dict[Axis, float]]

#: Of the difference quotient of a rate as a stage begins [s].
_INSTANT = 1e-6


def moving_axes(stage: Stage) -> dict[Axis, AxisMode]:
    """The axes that a stage's `axes` move, with their modes."""
    free = {a: entry.mode for a, entry in stage.axes.items() if not entry.has_force}
    return {a: mode for a, mode in free.items() if mode.moves}


def course_of(
    stage: StagePlan, start: Mapping[Axis, float], rates: Mapping[Axis, float]
) -> Course | None:
    """How a stage moves; None where that is not planned, or nothing says how long it lasts.

    Args:
        stage: the stage.
        start: coordinates of the tip in its frame as it starts [m, rad].
        rates: of the reference that is handed over [m/s, rad/s]; none for rest.
    """
    own: dict[Axis, tuple[AxisMode, Way]] = {}
    lasts = []
    path = stage.path
    if path is not None:
        duration, coordinates = timed(path, start)
        lasts.append(duration)
        for axis in path.axes:
            own[axis] = stage.plans[axis].mode, _on_path(coordinates, axis, duration, start[axis])
    for axis, mode in moving_axes(stage.spec).items():
        track = mode.track(0.0, rates.get(axis, 0.0))
        way = mode.way(stage.known, start[axis]) if track is None else track
        if way is None:
            return None
        own[axis] = mode, way
        if track is not None:
            lasts.append(float(track.knots[-2]))
    if stage.spec.time is not None:
        lasts = [stage.spec.time]
    if not lasts or not own:
        return None
    bends = path is not None or any(e.mode.bends for e in stage.spec.axes.values())
    return Course(max(lasts), begun_ways(stage, own, start, rates), bends)


def begun_ways(
    stage: StagePlan,
    own: Mapping[Axis, tuple[AxisMode, Way]],
    start: Mapping[Axis, float],
    rates: Mapping[Axis, float],
) -> dict[Axis, Way]:
    """Ways of references that continue the one handed over, as the modes hand it over."""
    handed = {}
    for axis, (mode, way) in own.items():
        begins = way(0.0)
        moves = 0.0 if axis in stage.from_rest else (way(_INSTANT) - begins) / _INSTANT
        handed[axis] = mode.hand_over(
            StageStart(
                axis=axis,
                plan=stage,
                starts=start,
                rates={a: rates.get(a, 0.0) for a in AXES},
                pressed=0.0,
                own=start[axis] + begins,
                own_rate=moves,
            )
        )
    wait = max((each.wait for each in handed.values()), default=0.0)

    def begun(axis: Axis) -> Way:
        way, each = own[axis][1], handed[axis]
        if axis in stage.from_rest:
            return lambda t: way(blend.from_rest(t - wait)) + each.added(t)
        return lambda t: way(t) + each.added(t)

    return {axis: _since(begun(axis)) for axis in own}


def _since(way: Way) -> Way:
    """The displacement from where a way begins."""
    begins = way(0.0)
    return lambda t: way(t) - begins


def _on_path(coordinates: Coordinates, axis: Axis, duration: float, start: float) -> Way:
    return lambda time: coordinates(min(time, duration))[axis] - start


def timed(path: PathShape, start: Mapping[Axis, float]) -> tuple[float, Coordinates]:
    """Duration [s] of a path, and its coordinates at a time; a table is taken as a polygon."""
    if path.table is None:
        plan = path.plan(start)

        def on_curve(time: float) -> dict[Axis, float]:
            curve = path.curve(plan.timing(time), start, {})
            return {a: float(value) for a, value in curve.items()}

        return plan.duration, on_curve
    table = path.table
    along, plan = table.argument(), path.plan(start)

    def on_polygon(time: float) -> dict[Axis, float]:
        at = plan.timing(time)
        return {a: float(np.interp(at, along, table.points[a])) for a in path.axes}

    return plan.duration, on_polygon
