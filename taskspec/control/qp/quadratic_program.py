"""What a solver is given and what it gives back, and how good an answer is."""

from __future__ import annotations

import enum
import math
from dataclasses import field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

Array = NDArray[np.float64]


class Status(enum.Enum):
    """How a solve ended. Only SOLVED has numbers that may be used."""

    SOLVED = "solved"
    INFEASIBLE = "infeasible"
    NOT_CONVERGED = "not converged"
    NOT_FINITE = "not finite"


@dataclass(frozen=True, slots=True)
class QuadraticProgram:
    """min 1/2 x'Px + g'x  subject to  lower <= Ax <= upper.

    The arrays stay the same objects for as long as the problem lives and are rewritten in place
    each tick, so that a compiled function can write into them and a solver can keep views.

    Attributes:
        P: (n, n) symmetric positive definite; both triangles are filled in.
        g: (n,).
        A: (m, n).
        lower: (m,), -inf where there is no bound.
        upper: (m,), +inf where there is no bound.
        flat_P: (n * n,) view of P.
        flat_A: (m * n,) view of A.

    Raises:
        ValueError: an array has another shape, is not float64, or is not C-contiguous.
    """

    P: Array
    g: Array
    A: Array
    lower: Array
    upper: Array
    flat_P: Array = field(init=False, repr=False)
    flat_A: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        m, n = self.A.shape
        shapes = {"P": (n, n), "g": (n,), "A": (m, n), "lower": (m,), "upper": (m,)}
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape or array.dtype != np.float64 or not array.flags.c_contiguous:
                raise ValueError(
                    f"{name} must be a C-contiguous float64 array of shape {shape}, "
                    f"not {array.dtype} of shape {array.shape}"
                )
        object.__setattr__(self, "flat_P", self.P.reshape(-1))
        object.__setattr__(self, "flat_A", self.A.reshape(-1))

    @classmethod
    def empty(cls, n: int, m: int) -> QuadraticProgram:
        """A problem of n unknowns and m rows that requests nothing: x = 0 solves it."""
        infinite = np.full(m, np.inf)
        return cls(np.eye(n), np.zeros(n), np.zeros((m, n)), -infinite, infinite)

    def is_finite(self) -> bool:
        """False when P, g or A has a NaN or an infinity, or a bound is NaN.

        Four inner products, about 1 us: a NaN survives a sum of squares. Numbers beyond 1e150,
        whose squares overflow, count as infinite.
        """
        P, g, A, lower, upper = self.flat_P, self.g, self.flat_A, self.lower, self.upper
        if not math.isfinite(P.dot(P) + g.dot(g) + A.dot(A)):
            return False
        return not math.isnan(lower.dot(lower) + upper.dot(upper))


class Solution(NamedTuple):
    """Answer to a problem.

    Attributes:
        x: (n,), NaN unless solved.
        dual: (m,) y of Px + g + A'y = 0: y >= 0 where the upper bound holds x back, y <= 0 where
            the lower one does. NaN unless solved.
        status: how the solve ended.
        iterations: what the solver counts as such.
    """

    x: Array
    dual: Array
    status: Status
    iterations: int


class Solver(Protocol):
    """Solves problems of one size; keeps memory between solves, never the problem."""

    def solve(self, problem: QuadraticProgram, *, finite: bool = False) -> Solution:
        """Solves a problem of the size that the solver was made for.

        Args:
            problem: the problem.
            finite: its numbers are known to be finite, bounds apart.
        """

    def rebuild(self) -> None:
        """Forgets everything about earlier problems."""


def unsolved(n: int, m: int) -> tuple[Array, Array]:
    """x (n,) and dual (m,) of NaN, read-only: what a solve without an answer returns."""
    x, dual = np.full(n, np.nan), np.full(m, np.nan)
    x.setflags(write=False)
    dual.setflags(write=False)
    return x, dual


def residual(problem: QuadraticProgram, x: Array, dual: Array) -> float:
    """Largest of the four scaled errors in the Karush-Kuhn-Tucker conditions, without unit.

    - stationarity |Px + g + A'y|, over max(1, |Px|, |g|, |A'y|);
    - primal violation max(0, Ax - upper, lower - Ax), over max(1, |Ax|);
    - dual sign: y > 0 on a row without upper bound, or y < 0 without lower, over max(1, |y|);
    - complementarity max(|y+ (upper - Ax)|, |y- (Ax - lower)|), over max(1, |x'Px|, |g'x|).

    Norms are the largest absolute entry. NaN in, NaN out.

    Args:
        problem: the problem.
        x: (n,) answer.
        dual: (m,) multipliers.
    """
    Px, Aty, rows = problem.P @ x, problem.A.T @ dual, problem.A @ x
    up, down = np.maximum(dual, 0.0), np.maximum(-dual, 0.0)
    bounded_up, bounded_down = np.isfinite(problem.upper), np.isfinite(problem.lower)
    above = np.where(bounded_up, rows - problem.upper, -math.inf)
    below = np.where(bounded_down, problem.lower - rows, -math.inf)
    slack_up = np.where(bounded_up, up * np.where(bounded_up, above, 0.0), 0.0)
    slack_down = np.where(bounded_down, down * np.where(bounded_down, below, 0.0), 0.0)
    errors = (
        _largest(Px + problem.g + Aty) / max(1.0, _largest(Px), _largest(problem.g), _largest(Aty)),
        max(0.0, float(np.max(np.maximum(above, below), initial=0.0))) / max(1.0, _largest(rows)),
        max(_largest(up[~bounded_up]), _largest(down[~bounded_down])) / max(1.0, _largest(dual)),
        max(_largest(slack_up), _largest(slack_down))
        / max(1.0, abs(float(x @ Px)), abs(float(problem.g @ x))),
    )
    return math.nan if any(math.isnan(e) for e in errors) else max(errors)


def _largest(values: Array) -> float:
    return float(np.max(np.abs(values), initial=0.0))
