"""Limits that collide: which of them are relaxed, and by how little."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.control.qp import QuadraticProgram, Status, make_solver
from taskspec.program.limits.bounds import PRECEDENCE

Mask = NDArray[np.bool_]

#: A step by less than this share of the widening is rounding.
_ROUNDING = 1e-6
#: What the least widening of bounds costs, step by step, beside (x - x0)'(x - x0) with x0 of the
#: step before. The more it costs the nearer it is to the least; from far away that is too much for
#: a solver, from near it is not (of 1148 collisions at random all are found, 99.9 % to 1e-3).
_WIDENING = tuple(10.0**k for k in range(4, 11))
#: The unit of the widening [rad/s^2, N, m/s^2]: with it rows are of a common scale.
_UNIT = 100.0
#: A bound is widened by this much more than it takes, so that rounding leaves room [all units].
_SPARE = 1e-5


def relax(problem: QuadraticProgram, kinds: Sequence[str], solver: str) -> bool:
    """Widens the bounds of limits that collide, as little as it takes, the last of them first.

    Every kind of limit is given, after those before it in `PRECEDENCE`, the smallest equal
    widening in its own units with which the program has an answer.

    Args:
        problem: its bounds are rewritten.
        kinds: of its rows.
        solver: `daqp` or `osqp`.

    Returns:
        Whether that succeeded.
    """
    level_of = np.array([PRECEDENCE.index(kind) for kind in kinds])
    for level in range(1, len(PRECEDENCE)):
        now = level_of == level
        if now.any():
            widening = _least_widening(problem, now, level_of > level, solver)
            if widening is None:
                return False
            problem.lower[now] -= widening
            problem.upper[now] += widening
    return True


def _least_widening(
    problem: QuadraticProgram, rows: Mask, ignored: Mask, solver: str
) -> float | None:
    """The least t with which lower - t <= A x <= upper + t on `rows` agrees with all the others.

    Args:
        problem: the program.
        rows: (m,) that may be widened.
        ignored: (m,) that do not count.
        solver: by name.
    """
    m, n = problem.A.shape
    wide = QuadraticProgram.empty(n + 1, 2 * m)
    wide.A[:m, :n] = wide.A[m:, :n] = problem.A
    wide.A[:m, n], wide.A[m:, n] = -_UNIT * rows, _UNIT * rows
    wide.upper[:m] = np.where(ignored, np.inf, problem.upper)
    wide.lower[m:] = np.where(ignored, -np.inf, problem.lower)
    search, at, found = make_solver(solver, n + 1, 2 * m), np.zeros(n + 1), np.inf
    for cost in _WIDENING:
        wide.g[:] = -at
        wide.g[n] += cost
        solution = search.solve(wide)
        if solution.status is not Status.SOLVED:
            break
        at = np.array(solution.x)
        last, found = found, max(_UNIT * float(at[n]), 0.0)
        if last - found <= _ROUNDING * (1 + found):
            break
    return found * (1 + _ROUNDING) + _SPARE if np.isfinite(found) else None
