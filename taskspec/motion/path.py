"""Paths: curves in the frame's coordinates, run through by one timing.

A path is symbolic in the tick (`curve`). Its timing is one of numbers where it is known from the
file, and follows from where its stage is entered otherwise (`plan`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from typing import Any

import casadi as ca
import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.motion.blend import BLEND_TIME
from taskspec.motion.polynomial import PiecewiseCubic, evaluate, from_states
from taskspec.motion.profile import timing
from taskspec.motion.table import Table


@dataclass(frozen=True, slots=True)
class PathShape:
    """One path of a task file, in SI units.

    Attributes:
        kind: to, line, arc, lissajous or file.
        axes: the axes that it drives.
        numbers: per axis: target (to), displacement (line), amplitude (lissajous) [m, rad].
        turns: per axis of a lissajous, or {"": turns} of an arc.
        center: of an arc, (x, y) in the frame's coordinates [m].
        table: of a file; splines: through it, once `ready`.
        speed, time: one of them, or neither for a table with a t column.
    """

    kind: str
    axes: tuple[Axis, ...]
    numbers: Mapping[Axis, float] = field(default_factory=dict)
    turns: Mapping[str, float] = field(default_factory=dict)
    center: tuple[float, float] = (0.0, 0.0)
    table: Table | None = None
    splines: Mapping[str, PiecewiseCubic] = field(default_factory=dict)
    speed: float | None = None
    time: float | None = None

    def curve(
        self, s: ca.SX, start: Mapping[Axis, ca.SX], segments: Mapping[Axis, ca.SX]
    ) -> dict[Axis, ca.SX]:
        """Coordinates of the driven axes at path parameter s.

        Args:
            s: the path parameter, 0 to 1, or the time of a table with a t column.
            start: coordinates of the handed-over reference at entry; an arc needs x and y.
            segments: the current cubic (5,) of each axis of a table.
        """
        if self.kind == "to":
            return {a: start[a] + s * (self.numbers[a] - start[a]) for a in self.axes}
        if self.kind == "line":
            return {a: start[a] + s * self.numbers[a] for a in self.axes}
        if self.kind == "lissajous":
            return {
                a: start[a] + self.numbers[a] * ca.sin(2 * ca.pi * self.turns[a] * s)
                for a in self.axes
            }
        if self.kind == "arc":
            angle = 2 * ca.pi * self.turns[""] * s
            dx, dy = start[Axis.X] - self.center[0], start[Axis.Y] - self.center[1]
            point = {
                Axis.X: self.center[0] + ca.cos(angle) * dx - ca.sin(angle) * dy,
                Axis.Y: self.center[1] + ca.sin(angle) * dx + ca.cos(angle) * dy,
            }
            return {a: point[a] for a in self.axes}
        return {a: evaluate(segments[a], s) for a in self.axes}

    def ready(self) -> PathShape:
        """The same path with the splines of its table, which take a while to lay."""
        if self.table is None:
            return self
        splines = {a: p for a, p in self.table.splines().items() if a in self.axes}
        return replace(self, splines=splines)

    def plan(self, start: Mapping[Axis, Any]) -> PathPlan:
        """Times the path from the coordinates at which its stage is entered.

        Args:
            start: numbers, or expressions.
        """
        if self.table is not None:
            splines = self.splines
            if self.table.time is not None:
                knots = self.table.time
                duration = float(knots[-1] - knots[0])
                clock = _clock(float(knots[0]), duration, from_rest=self.table.begins_moving)
                return PathPlan(clock, splines, duration)
            along = timing(self.table.length, speed=self.speed, time=self.time)
            return PathPlan(along, splines, along.rests)
        along = timing(self.length(start), speed=self.speed, time=self.time)
        return PathPlan(along, {}, along.rests)

    def length(self, start: Mapping[Axis, Any]) -> Any:
        """Length [m] over the driven translations; [rad] for a path that only turns."""
        if self.kind == "arc":
            dx, dy = start[Axis.X] - self.center[0], start[Axis.Y] - self.center[1]
            return _norm([dx, dy]) * 2 * math.pi * abs(self.turns[""])
        moved = self._length([a for a in self.axes if not a.is_rotation], start)
        turned = self._length([a for a in self.axes if a.is_rotation], start)
        if isinstance(moved, float):
            return moved or turned
        return ca.if_else(moved > 0, moved, turned)

    def _length(self, axes: Sequence[Axis], start: Mapping[Axis, Any]) -> Any:
        if not axes:
            return 0.0
        if self.kind == "lissajous":
            s = np.linspace(0.0, 1.0, 2001)
            points = [self.numbers[a] * np.sin(2 * np.pi * self.turns[a] * s) for a in axes]
            return float(np.linalg.norm(np.diff(np.array(points), axis=1), axis=0).sum())
        ends = [self.numbers[a] - (start[a] if self.kind == "to" else 0.0) for a in axes]
        return _norm(ends)


@dataclass(frozen=True, slots=True)
class PathPlan:
    """A timed path.

    Attributes:
        timing: s against time [s].
        splines: of a table against s.
        duration: until it rests [s]; an expression where the timing is made of such.
    """

    timing: PiecewiseCubic
    splines: Mapping[str, PiecewiseCubic]
    duration: Any

    def knots(self) -> list[float]:
        """Times [s] at which some cubic of the plan changes."""
        points = {id(spline.knots): spline.knots[1:-1] for spline in self.splines.values()}
        passed = [self.timing.first_reaching(knots) for knots in points.values()]
        times: list[float] = np.unique(np.concatenate([self.timing.knots[1:], *passed])).tolist()
        return times


def _clock(start: float, duration: float, *, from_rest: bool) -> PiecewiseCubic:
    """Time of a table that tells it itself, against stage time [s].

    One that begins in motion starts from rest: its rate rises in `BLEND_TIME` to what then still
    brings it to its end in time, so that it goes faster by at most that share.
    """
    if not from_rest:
        return PiecewiseCubic(
            np.array([0.0, duration, duration + 1.0]),
            np.array([[start, 1.0, 0.0, 0.0], [start + duration, 0.0, 0.0, 0.0]]),
        )
    rise = min(BLEND_TIME, duration / 2)
    rate = duration / (duration - rise / 2)
    return from_states(
        [0.0, rise / 2, rise, duration],
        [
            (start, 0.0, 0.0),
            (start + rate * rise / 12, rate / 2, 2 * rate / rise),
            (start + rate * rise / 2, rate, 0.0),
            (start + duration, rate, 0.0),
        ],
    )


def _norm(values: Sequence[Any]) -> Any:
    """The Euclidean norm of numbers or expressions."""
    if all(isinstance(value, float | int) for value in values):
        return math.hypot(*values)
    return ca.norm_2(ca.vertcat(*values))


def coordinates(values: Sequence[float]) -> dict[Axis, float]:
    """A list of path coordinates by axis name, in the order x, y, z, rx, ry, rz."""
    return dict(zip(AXES, values, strict=False))
