"""Motion of the references of a stage against time, as far as the text determines it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import AxisMode, Displacement, StageStart
from taskspec.motion import blend
from taskspec.motion.path import PathShape
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import rate_from

Vector = NDArray[np.float64]
Coordinates = Callable[[float], dict[Axis, float]]


@dataclass(frozen=True, slots=True)
class ReferenceMotion:
    """Motion of the references of a stage.

    Attributes:
        displacements: displacement of each axis that is to move against time [m, rad].
        lasts: until moves, path and time are done [s]; None where none of them ends.
        path_lasts: until the path is done [s]; None without one.
    """

    displacements: Mapping[Axis, Displacement]
    lasts: float | None
    path_lasts: float | None


def reference_motion(
    stage: StagePlan, start: Mapping[Axis, float], rates: Mapping[Axis, float]
) -> ReferenceMotion | None:
    """The references of a stage; None where the text does not say how one of them moves.

    An axis that follows a mechanism has no reference of its own. One that follows others goes by
    theirs; a leader that has none is taken to stay where it starts.

    Args:
        stage: the stage.
        start: coordinates of the control point in its frame as it starts [m, rad].
        rates: of the reference that is handed over [m/s, rad/s]; none for rest.
    """
    own: dict[Axis, tuple[AxisMode, Displacement]] = {}
    ends = [] if stage.spec.time is None else [stage.spec.time]
    path_lasts = None
    if stage.path is not None:
        path_lasts, coordinates = _timed(stage.path, start, stage.path_share)
        ends += [path_lasts] if math.isfinite(path_lasts) else []
        for axis in stage.path.axes:
            own[axis] = stage.plans[axis].mode, _on_path(coordinates, axis, path_lasts, start[axis])
    for axis, plan in stage.plans.items():
        mode = plan.mode
        if axis in own or not plan.motion or plan.axis.has_force:
            continue
        if not mode.moves or not mode.leads or mode.leaders:
            continue
        track = mode.track(0.0, rates.get(axis, 0.0))
        displacement = mode.displacement(stage.known, start[axis]) if track is None else track
        if displacement is None or not math.isfinite(displacement(0.0)):
            return None
        own[axis] = mode, displacement
        if track is not None:
            ends.append(float(track.rests))
    begun = _begun(stage, own, start, rates)
    for axis in stage.leaders_first:
        if stage.plans[axis].mode.leaders:
            followed = {axis: (stage.plans[axis].mode, _followed(stage, axis, begun, start))}
            begun |= _begun(stage, followed, start, rates)
    return ReferenceMotion(begun, max(ends, default=None), path_lasts)


def start_coordinates(stage: StagePlan, p: Vector, R: Vector) -> dict[Axis, float]:
    """Coordinates of the control point in a stage's frame as it starts [m, rad].

    Args:
        stage: the stage.
        p, R: (3,), (3, 3) the tip, world axes.
    """
    found = dict.fromkeys(AXES, 0.0)
    frame, context = stage.frame, stage.context
    if frame.still:
        rotation, origin = context.placed(frame)
        control = origin if frame.at_origin else p
        found |= dict(zip(AXES[:3], (rotation.T @ (control - origin)).tolist(), strict=True))
    elif frame.surface_name:
        found[Axis.Z] = context.obstacles.gap(frame.surface_name, p, R)
    return found


def _followed(
    stage: StagePlan,
    axis: Axis,
    leading: Mapping[Axis, Displacement],
    start: Mapping[Axis, float],
) -> Displacement:
    """What an expression of other axes makes of their displacements, from where the axis starts."""
    (expression, _), *_ = stage.plans[axis].mode.expressions()
    leaders = stage.plans[axis].mode.leaders

    def moved(time: float) -> float:
        at = {a: start[a] + (leading[a](time) if a in leading else 0.0) for a in leaders}
        value = stage.known(expression, {str(a): x for a, x in at.items()})
        assert value is not None
        return value - start[axis]

    return moved


def _begun(
    stage: StagePlan,
    own: Mapping[Axis, tuple[AxisMode, Displacement]],
    start: Mapping[Axis, float],
    rates: Mapping[Axis, float],
) -> dict[Axis, Displacement]:
    """Displacements of references that continue the one handed over, as the modes hand it over."""
    handed = {}
    for axis, (mode, displacement) in own.items():
        begins = displacement(0.0)
        moves = 0.0 if axis in stage.from_rest else rate_from(displacement, 0.0)
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

    def begun(axis: Axis) -> Displacement:
        displacement, each = own[axis][1], handed[axis]
        if axis in stage.from_rest:
            return lambda t: displacement(blend.from_rest(t - wait)) + each.added(t)
        return lambda t: displacement(t) + each.added(t)

    return {axis: _since(begun(axis)) for axis in own}


def _since(displacement: Displacement) -> Displacement:
    """The displacement from its first value."""
    begins = displacement(0.0)
    return lambda t: displacement(t) - begins


def _on_path(coordinates: Coordinates, axis: Axis, duration: float, start: float) -> Displacement:
    return lambda time: coordinates(min(time, duration))[axis] - start


def _timed(path: PathShape, start: Mapping[Axis, float], share: float) -> tuple[float, Coordinates]:
    """Duration [s] of a path, and its coordinates at a time.

    Its time goes at a share of the stage's.
    """
    plan = path.plan(start)

    @lru_cache(maxsize=1)  # its axes are computed one after the other
    def at(time: float) -> dict[Axis, float]:
        s = plan.timing(time * share)
        return {a: path.form.place(s, start, a) for a in path.axes}

    return float(plan.duration) / share if share > 0 else math.inf, at
