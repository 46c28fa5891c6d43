"""Piecewise cubics: the one form in which moves, path timings and tables reach the tick.

The tick evaluates a single cubic from its parameters; the stage renews those parameters when the
argument passes a knot. So a table of any length costs the tick the same.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

#: Numbers of one cubic: start of the argument, then c0..c3.
SEGMENT_SIZE = 5


@dataclass(frozen=True, slots=True)
class PiecewiseCubic:
    """c0 + c1 s + c2 s^2 + c3 s^3 with s = x - knots[i] on each interval.

    Attributes:
        knots: (k + 1,) increasing arguments; the last one ends the last interval.
        coefficients: (k, 4).
    """

    knots: NDArray[np.float64]
    coefficients: NDArray[np.float64]

    @property
    def end(self) -> float:
        """The last knot."""
        return float(self.knots[-1])

    def index(self, x: float) -> int:
        """Number of the interval that holds x; the ends extend outwards."""
        return min(max(bisect_right(self.knots, x) - 1, 0), len(self.coefficients) - 1)

    def segment(self, x: float) -> NDArray[np.float64]:
        """The (5,) parameters of the interval that holds x."""
        i = self.index(x)
        return np.concatenate([[self.knots[i]], self.coefficients[i]])

    def __call__(self, x: float) -> float:
        """The value at x."""
        i = self.index(x)
        c0, c1, c2, c3 = self.coefficients[i].tolist()
        s = float(x) - float(self.knots[i])
        return float(c0 + s * (c1 + s * (c2 + s * c3)))

    def first_reaching(self, value: float) -> float:
        """The earliest argument at which a non-decreasing cubic reaches `value`."""
        low, high = float(self.knots[0]), self.end
        if self(high) <= value:
            return high
        for _ in range(80):
            middle = (low + high) / 2
            low, high = (low, middle) if self(middle) >= value else (middle, high)
        return high


def evaluate(segment: ca.SX, x: ca.SX) -> ca.SX:
    """The cubic with parameters `segment` (5,) at x."""
    s = x - segment[0]
    return segment[1] + s * (segment[2] + s * (segment[3] + s * segment[4]))


def constant(value: float) -> PiecewiseCubic:
    """A constant as a cubic."""
    return PiecewiseCubic(np.array([0.0, 0.0]), np.array([[value, 0.0, 0.0, 0.0]]))


def from_states(
    knots: Sequence[float], states: Sequence[tuple[float, float, float]]
) -> PiecewiseCubic:
    """The cubics of constant jerk through (position, velocity, acceleration) at each knot.

    A last interval of rest at the final position is appended.
    """
    rows = []
    for i in range(len(knots) - 1):
        p, v, a = states[i]
        jerk = (states[i + 1][2] - a) / (knots[i + 1] - knots[i])
        rows.append([p, v, a / 2, jerk / 6])
    rows.append([states[-1][0], 0.0, 0.0, 0.0])
    return PiecewiseCubic(np.array([*knots, knots[-1] + 1.0]), np.array(rows))
