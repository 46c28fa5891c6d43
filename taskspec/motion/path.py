"""A stage's path: the curve of its form, run through by one timing.

A path is symbolic in the tick (`curve`). Its timing is one of numbers where it is known from the
file, and follows from where its stage is entered otherwise (`plan`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field, replace
from typing import Any

import casadi as ca
import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression
from taskspec.geometry.axis import Axis
from taskspec.motion.paths import PathForm
from taskspec.motion.polynomial import PiecewiseCubic


@dataclass(frozen=True, slots=True)
class PathShape:
    """One path of a task file, in SI units.

    Attributes:
        form: of the curve.
        axes: the axes that it drives.
        splines: of a form that is laid in such, once `ready`.
        speed, time: one of them, or neither for a table with a t column.
        slowed: its speed as signals decide it, `speed` at the most; None where none do.
    """

    form: PathForm
    axes: tuple[Axis, ...]
    splines: Mapping[Axis, PiecewiseCubic] = field(default_factory=dict)
    speed: float | None = None
    time: float | None = None
    slowed: Expression | None = None

    def curve(
        self, s: ca.SX, start: Mapping[Axis, ca.SX], segments: Mapping[Axis, ca.SX]
    ) -> dict[Axis, ca.SX]:
        """Coordinates of the driven axes at path parameter s.

        Args:
            s: the path parameter, 0 to 1, or the time of a table with a t column.
            start: coordinates of the handed-over reference at entry, of the axes that the form
                needs.
            segments: the current cubic (5,) of each axis of a form that is laid in splines.
        """
        return {a: self.form.curve(s, start, segments, a) for a in self.axes}

    def ready(self) -> PathShape:
        """The same path with its splines, which take a while to lay."""
        return replace(self, splines=self.form.splines(self.axes))

    def plan(self, start: Mapping[Axis, Any]) -> PathPlan:
        """Times the path from the coordinates at which its stage is entered.

        Args:
            start: numbers, or expressions.
        """
        along = self.form.timing(start, self.axes, self.speed, self.time)
        return PathPlan(along, self.splines, along.rests)

    def length(self, start: Mapping[Axis, Any]) -> Any:
        """Length [m] over the driven translations; [rad] for a path that only turns."""
        return self.form.length(start, self.axes)


@dataclass(frozen=True, slots=True)
class PathPlan:
    """A timed path.

    Attributes:
        timing: s against time [s].
        splines: of a path that is laid in such, against s.
        duration: until it rests [s]; an expression where the timing is made of such.
    """

    timing: PiecewiseCubic
    splines: Mapping[Axis, PiecewiseCubic]
    duration: Any

    def knots(self) -> list[float]:
        """Times [s] at which some cubic of the plan changes."""
        points = {id(spline.knots): spline.knots[1:-1] for spline in self.splines.values()}
        passed = [self.timing.first_reaching(knots) for knots in points.values()]
        times: list[float] = np.unique(np.concatenate([self.timing.knots[1:], *passed])).tolist()
        return times
