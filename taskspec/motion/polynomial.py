"""Piecewise cubics: the one form in which moves, path timings and tables reach the tick.

The tick evaluates a single cubic from its parameters; the stage renews those parameters when the
argument passes a knot. So a table of any length costs the tick the same.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass

if TYPE_CHECKING:
    from numpy.typing import NDArray

    #: Numbers, or expressions where a cubic follows from what is known when a stage is entered.
    Values = NDArray[np.float64] | Any

#: Numbers of one cubic: start of the argument, then c0..c3.
SEGMENT_SIZE = 5


@dataclass(frozen=True, slots=True)
class PiecewiseCubic:
    """c0 + c1 s + c2 s^2 + c3 s^3 with s = x - knots[i] on each interval.

    Attributes:
        knots: (k + 1,) arguments that do not decrease; the last one ends the last interval.
        coefficients: (k, 4).
    """

    knots: Values
    coefficients: Values

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

    @property
    def rests(self) -> Any:
        """The knot at which its last, constant interval begins."""
        return self.knots[self.coefficients.shape[0] - 1]

    def segment_at_start(self) -> ca.SX:
        """The (5,) parameters of the interval that holds 0, of a cubic of expressions."""
        return _segment_at_start(self.coefficients.shape[0])(self.knots, self.coefficients)

    def first_reaching(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """The earliest arguments at which a non-decreasing cubic reaches `values` (m,)."""
        low, high = (np.full(len(values), each) for each in (self.knots[0], self.knots[-1]))
        never = self(self.end) <= values
        for _ in range(80):
            middle = (low + high) / 2
            i = np.clip(
                np.searchsorted(self.knots, middle, side="right") - 1, 0, len(self.coefficients) - 1
            )
            c0, c1, c2, c3 = self.coefficients[i].T
            s = middle - self.knots[i]
            beyond = c0 + s * (c1 + s * (c2 + s * c3)) >= values
            low, high = np.where(beyond, low, middle), np.where(beyond, middle, high)
        return np.where(never, self.end, high)


@cache
def _segment_at_start(count: int) -> ca.Function:
    knots, coefficients = ca.SX.sym("knots", count + 1), ca.SX.sym("coefficients", count, 4)
    rows = [ca.vertcat(knots[i], coefficients[i, :].T) for i in range(count)]
    found = rows[0]
    for row in rows[1:]:
        found = ca.if_else(row[0] <= 0, row, found)
    return ca.Function("segment", [knots, coefficients], [found])


def evaluate(segment: ca.SX, x: ca.SX) -> ca.SX:
    """The cubic with parameters `segment` (5,) at x."""
    s = x - segment[0]
    return segment[1] + s * (segment[2] + s * (segment[3] + s * segment[4]))


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
