"""Paths that are laid when a task is compiled: straight legs, arcs and curves in splines."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.motion.paths.form import Number, PathForm
from taskspec.motion.profile import PathSection, timing_by_sections

if TYPE_CHECKING:
    from taskspec.deferred import ca
    from taskspec.motion.polynomial import PiecewiseCubic

#: Kept: those of one task.
_KEPT = 64


@dataclass(frozen=True, slots=True)
class Route:
    """A laid path.

    Attributes:
        splines: coordinates against s from 0 to 1 [m, rad].
        sections: one after the other, each with the greatest curvature on it.
    """

    splines: Mapping[Axis, PiecewiseCubic]
    sections: tuple[PathSection, ...]

    @property
    def length(self) -> float:
        """Of all sections [m]."""
        return math.fsum(section.length for section in self.sections)


class LaidPath(PathForm):
    """A path that is laid when a task is compiled, and slows down where it bends.

    The acceleration along and across it stays within that of a move at its speed, 2 v/T.
    """

    def lay(self) -> Route:
        """The path; made once."""
        raise NotImplementedError

    @property
    def route(self) -> Route:
        """The laid path."""
        return _laid(self)

    def moves(self, axis: Axis) -> bool:
        """Where its spline changes."""
        spline = self.route.splines[axis]
        first = spline.coefficients[0][0]
        return any(c0 != first for c0, *_ in spline.coefficients) or any(
            c for row in spline.coefficients for c in row[1:]
        )

    def needs(self, axes: Sequence[Axis]) -> tuple[Axis, ...]:
        """The start, if it counts from there."""
        return tuple(axes) if self.relative else ()

    def curve(
        self,
        s: ca.SX,
        start: Mapping[Axis, Number],
        segments: Mapping[Axis, ca.SX],
        axis: Axis,
    ) -> Number:
        """On its splines."""
        from taskspec.motion.polynomial import evaluate

        begins = start[axis] if self.relative else 0.0
        return begins + evaluate(segments[axis], s)

    def place(self, s: float, start: Mapping[Axis, float], axis: Axis) -> float:
        """On its splines."""
        begins = start[axis] if self.relative else 0.0
        return begins + self.route.splines[axis](s)

    @property
    def in_splines(self) -> bool:
        """Known from the file."""
        return True

    def splines(self, axes: Sequence[Axis]) -> dict[Axis, PiecewiseCubic]:
        """Those of the axes."""
        return {a: p for a, p in self.route.splines.items() if a in axes}

    def length(self, start: Mapping[Axis, Number], axes: Sequence[Axis]) -> Any:  # noqa: ARG002
        """Along all of its axes, driven or not."""
        return self.route.length

    def timing(
        self,
        start: Mapping[Axis, Number],  # noqa: ARG002
        axes: Sequence[Axis],  # noqa: ARG002
        speed: float | None,
        time: float | None,
    ) -> PiecewiseCubic:
        """At its speed on straight legs, slower where it bends."""
        return _timed(self, speed, time)


@lru_cache(maxsize=_KEPT)
def _laid(path: LaidPath) -> Route:
    return path.lay()


@lru_cache(maxsize=_KEPT)
def _timed(path: LaidPath, speed: float | None, time: float | None) -> PiecewiseCubic:
    return timing_by_sections(path.route.sections, speed=speed, time=time)
