"""Moves and paths of a stage that has been entered: cubics that the tick sees one at a time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.motion.path import PathPlan
from taskspec.motion.polynomial import PiecewiseCubic
from taskspec.program.stages.stage import CompiledStage

Vector = NDArray[np.float64]


@dataclass(slots=True)
class Tracks:
    """The piecewise cubics of a stage and the next time at which one of them changes."""

    cubics: dict[str, PiecewiseCubic] = field(default_factory=dict)
    path: PathPlan | None = None
    knots: list[float] = field(default_factory=list)
    passed: int = 0

    @property
    def duration(self) -> float:
        """Stage time [s] at which all of them are done."""
        ends = [float(c.knots[-2]) for c in self.cubics.values()]
        return max([0.0, *ends, self.path.duration if self.path else 0.0])

    @property
    def next_knot(self) -> float:
        """Stage time [s] of the next change, infinite after the last."""
        return self.knots[self.passed] if self.passed < len(self.knots) else np.inf

    def refresh(self, stage: CompiledStage, parameters: Vector, t: float) -> None:
        """Writes the segments that hold at stage time t [s] into the parameters."""
        while self.next_knot <= t:
            self.passed += 1
        for name, cubic in self.cubics.items():
            stage.parameters.write(parameters, f"segment.{name}", cubic.segment(t))
        if self.path is not None:
            timing = self.path.timing
            stage.parameters.write(parameters, "segment.path", timing.segment(t))
            s = timing(t)
            for axis, spline in self.path.splines.items():
                stage.parameters.write(parameters, f"table.{axis}", spline.segment(s))


def plan_tracks(
    stage: CompiledStage, start: Mapping[Axis, float], rate: Mapping[Axis, float]
) -> Tracks:
    """Plans a stage's moves and its path from the coordinates and rates at which it is entered."""
    tracks = Tracks()
    for name, plan in stage.plan.plans.items():
        cubic = plan.mode.track(start[name], rate[name]) if plan.motion else None
        if cubic is not None:
            tracks.cubics[name] = cubic
    if stage.plan.ready_path is not None:
        tracks.path = stage.plan.ready_path.plan(start)
    knots = [float(k) for cubic in tracks.cubics.values() for k in cubic.knots[1:]]
    tracks.knots = sorted(set(knots + (tracks.path.knots() if tracks.path else [])))
    return tracks
