"""References of a stage against time: what its modes and its path ask of every axis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.foresight.course import begun_ways, timed
from taskspec.geometry.axis import Axis
from taskspec.modes import AxisMode, Way
from taskspec.program.plan import StagePlan

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ReferenceMotion:
    """How the references of a stage move.

    Attributes:
        ways: displacement of each axis that is to move against time [m, rad].
        lasts: until moves, path and time are done [s]; None where none of them ends.
        path_lasts: until the path is done [s]; None without one.
    """

    ways: Mapping[Axis, Way]
    lasts: float | None
    path_lasts: float | None


def reference_motion(stage: StagePlan, start: Mapping[Axis, float]) -> ReferenceMotion | None:
    """The references of a stage that starts from rest; None where the text does not tell them.

    Args:
        stage: the stage.
        start: coordinates of the control point in its frame as it starts [m, rad].
    """
    own: dict[Axis, tuple[AxisMode, Way]] = {}
    ends = [] if stage.spec.time is None else [stage.spec.time]
    path_lasts = None
    if stage.path is not None:
        path_lasts, coordinates = timed(stage.path, start)
        ends.append(path_lasts)

        def on_path(axis: Axis, lasts: float) -> Way:
            return lambda t: coordinates(min(t, lasts))[axis] - start[axis]

        own |= {a: (stage.plans[a].mode, on_path(a, path_lasts)) for a in stage.path.axes}
    for axis, plan in stage.plans.items():
        mode = plan.mode
        if axis in own or not plan.motion or plan.axis.has_force:
            continue
        if not mode.moves or not mode.leads:
            continue
        track = mode.track(0.0, 0.0)
        way = mode.way(stage.known, start[axis]) if track is None else track
        if way is None or not math.isfinite(way(0.0)):
            return None
        own[axis] = mode, way
        if track is not None:
            ends.append(float(track.knots[-2]))
    return ReferenceMotion(begun_ways(stage, own, start, {}), max(ends, default=None), path_lasts)
