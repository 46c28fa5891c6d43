"""Certificate of infeasibility: rows of inequalities that contradict each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.control.qp.make import make_solver
from taskspec.control.qp.quadratic_program import Array, QuadraticProgram, Status
from taskspec.deferred_methods import dataclass

Rows = NDArray[np.intp]

# Rows are scaled to unit length, so it is a length in the space of x over its own unit.
_NULL = 1e-7


@dataclass(frozen=True, slots=True)
class Certificate:
    """Proof that rows contradict each other (Farkas): A'y = 0, yet upper'y+ + lower'y- < 0.

    Attributes:
        rows: the rows, ascending. They contradict each other, and no fewer of them do.
        multipliers: y of each, the largest 1 in absolute value. Positive where the row's upper
            bound takes part, negative where its lower one does. A single row whose own bounds
            cross has 1.
        gap: -(upper'y+ + lower'y-) > 0, by how much they miss each other.
    """

    rows: tuple[int, ...]
    multipliers: tuple[float, ...]
    gap: float


def contradiction(
    A: Array, lower: Array, upper: Array, given: Sequence[int] = ()
) -> Certificate | None:
    """Rows of lower <= Ax <= upper that no x satisfies together, None when some x does.

    DAQP tries, row by row, what is infeasible still without it; the rest is minimal, so its
    multipliers are the null space of A' restricted to it, which is one-dimensional and known to
    rounding.

    Args:
        A: (m, n).
        lower, upper: (m,), infinite where there is no bound.
        given: rows that others are tried to do without before them. Of the many minimal sets that
            there may be, one with few others is found.

    Raises:
        ValueError: A has a NaN or an infinity, or a bound is NaN.
    """
    crossed = np.flatnonzero(lower > upper)
    if crossed.size:
        row = int(crossed[0])
        return Certificate((row,), (1.0,), float(lower[row] - upper[row]))
    rows, low, high = _scaled(A, lower, upper)
    if not QuadraticProgram(np.eye(A.shape[1]), np.zeros(A.shape[1]), rows, low, high).is_finite():
        raise ValueError("the rows are not finite")
    named: Rows = np.arange(len(rows))
    if not _infeasible(rows, low, high, named):
        return None
    for candidate in (*np.setdiff1d(named, given).tolist(), *given):
        rest = named[named != candidate]
        if _infeasible(rows, low, high, rest):
            named = rest
    return _verified(A, lower, upper, np.sort(named))


def feasible(A: Array, lower: Array, upper: Array) -> bool:
    """Whether some x satisfies lower <= Ax <= upper, to 1e-9 of rows scaled to unit length."""
    rows, low, high = _scaled(A, lower, upper)
    return not _infeasible(rows, low, high, np.arange(len(rows)))


def _scaled(A: Array, lower: Array, upper: Array) -> tuple[Array, Array, Array]:
    """Rows of unit length, those of zeros left alone."""
    lengths = np.linalg.norm(A, axis=1)
    scale = 1.0 / np.where(lengths > 0, lengths, 1.0)
    return A * scale[:, None], lower * scale, upper * scale


def _infeasible(A: Array, lower: Array, upper: Array, named: Rows) -> bool:
    """True when no x satisfies the named rows."""
    if not named.size:
        return False
    n = A.shape[1]
    part = QuadraticProgram(np.eye(n), np.zeros(n), A[named], lower[named], upper[named])
    return make_solver("daqp", n, len(named)).solve(part).status is Status.INFEASIBLE


def _verified(A: Array, lower: Array, upper: Array, named: Rows) -> Certificate | None:
    """The certificate of a minimal set of rows, None when its multipliers do not prove it."""
    lengths = np.maximum(np.linalg.norm(A[named], axis=1), np.finfo(float).tiny)
    # The last right singular vector of A' spans the null space.
    y = np.linalg.svd((A[named] / lengths[:, None]).T)[2][-1] / lengths
    y = y / np.max(np.abs(y))
    for candidate in (y, -y):
        up, down = candidate > 0, candidate < 0
        bound = np.where(up, upper[named], np.where(down, lower[named], 0.0))
        gap = -float(np.dot(bound, candidate))
        closes = np.linalg.norm(A[named].T @ candidate) <= _NULL * np.max(
            lengths * np.abs(candidate)
        )
        if closes and np.isfinite(gap) and gap > 0:
            return Certificate(
                tuple(int(row) for row in named), tuple(float(v) for v in candidate), gap
            )
    return None
