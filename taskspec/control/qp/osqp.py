"""OSQP: an operator-splitting method; the second opinion."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import osqp
import scipy.sparse as sp

from taskspec.control.qp.quadratic_program import (
    QuadraticProgram,
    Solution,
    Status,
    unsolved,
)

# Nothing depends on measured time (no time limit, the step of rho at a fixed count), so that the
# same problems give the same bits. Polishing is off: it prints even when it is not verbose. The
# tolerances are near what the iteration still reaches: the default of 1e-3 misses bounds by that
# much, and at 1e-8 one of 1000 random problems of 13 unknowns and 40 rows does not converge, begun
# anew or not. The others take 300 to 600 iterations from another problem's answer, at most 6750.
SETTINGS: dict[str, Any] = {
    "eps_abs": 1e-8,
    "eps_rel": 1e-8,
    "eps_prim_inf": 1e-8,
    "eps_dual_inf": 1e-8,
    "max_iter": 8000,
    "check_termination": 25,
    "adaptive_rho": 1,
    "adaptive_rho_interval": 50,
    "polishing": False,
    "verbose": False,
    "warm_starting": True,
}


class OsqpSolver:
    """Solves with a dense pattern set up once, updated in place, started from the last answer.

    After anything but a solved or infeasible problem it is set up anew: a NaN stays in its
    iterates for good. Bounds are compared before they are handed over, since OSQP prints when
    they cross and keeps the old ones.
    """

    def __init__(self, n: int, m: int) -> None:
        """Takes the size of the problems: n unknowns, m rows."""
        self._n, self._m = n, m
        self._solver: osqp.OSQP | None = None
        columns, rows = np.tril_indices(n)
        self._triangle = rows * n + columns
        self._P = sp.csc_matrix(
            (np.ones(rows.size), rows, np.r_[0, np.cumsum(np.arange(1, n + 1))]), shape=(n, n)
        )
        self._A = sp.csc_matrix(
            (np.ones(m * n), np.tile(np.arange(m), n), np.arange(0, m * n + 1, m)), shape=(m, n)
        )
        self._columns = self._A.data.reshape(n, m)
        self._lower, self._upper = np.empty(m), np.empty(m)
        self._nothing = unsolved(n, m)
        self._status = {
            osqp.SolverStatus.OSQP_SOLVED: Status.SOLVED,
            osqp.SolverStatus.OSQP_PRIMAL_INFEASIBLE: Status.INFEASIBLE,
        }
        self._largest = float(osqp.constant("OSQP_INFTY", osqp.default_algebra()))

    def rebuild(self) -> None:
        """Forgets everything about earlier problems, the warm start included."""
        self._solver = None

    def solve(self, problem: QuadraticProgram, *, finite: bool = False) -> Solution:
        """Solves the problem to 1e-8, or says why not."""
        if not (finite or problem.is_finite()):
            self._solver = None
            return Solution(*self._nothing, Status.NOT_FINITE, 0)
        if _contradicts_itself(problem):
            return Solution(*self._nothing, Status.INFEASIBLE, 0)
        if not self._load(problem):
            return Solution(*self._nothing, Status.NOT_CONVERGED, 0)
        assert self._solver is not None
        result = self._solver.solve(raise_error=False)
        status = self._status.get(result.info.status_val, Status.NOT_CONVERGED)
        if status is Status.SOLVED and math.isfinite(result.x.dot(result.x)):
            return Solution(result.x, result.y, status, result.info.iter)
        if status is not Status.INFEASIBLE:
            status = Status.NOT_CONVERGED
        # An infeasible problem leaves iterates near 1e9 to start from.
        self._solver = None
        return Solution(*self._nothing, status, result.info.iter)

    def _load(self, problem: QuadraticProgram) -> bool:
        """Hands the data over; False when OSQP refuses them, such as an indefinite P."""
        np.take(problem.flat_P, self._triangle, out=self._P.data)
        np.copyto(self._columns, problem.A.T)
        np.maximum(problem.lower, -self._largest, out=self._lower)
        np.minimum(problem.upper, self._largest, out=self._upper)
        try:
            if self._solver is None:
                solver = osqp.OSQP()
                solver.setup(
                    self._P, problem.g.copy(), self._A, self._lower, self._upper, **SETTINGS
                )
                self._solver = solver
            else:
                self._solver.update(
                    q=problem.g,
                    l=self._lower,
                    u=self._upper,
                    Px=self._P.data,
                    Ax=self._A.data,
                )
        except (osqp.OSQPException, ValueError):
            self._solver = None
            return False
        return True


def _contradicts_itself(problem: QuadraticProgram) -> bool:
    """True when a single row cannot be met: its bounds cross, or one is infinite inwards."""
    lower, upper = problem.lower, problem.upper
    return bool((lower > upper).any() or (lower == math.inf).any() or (upper == -math.inf).any())
