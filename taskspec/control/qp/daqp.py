"""DAQP: a dual active-set method, exact to rounding in a few microseconds."""

from __future__ import annotations

import math

import daqp
import numpy as np

from taskspec.control.qp.quadratic_program import QuadraticProgram, Solution, Status, unsolved

# primal_tol is the violation, in rows scaled to unit length in the metric of P, up to which a
# bound counts as kept; 1e-6 by default. eps_prox = 0 switches off the proximal outer iteration,
# which is for singular P. eq_reduction = -1: eliminating equalities does not pay at this size.
SETTINGS = {"primal_tol": 1e-9, "eps_prox": 0.0, "eq_reduction": -1, "iter_limit": 1000}

_OPTIMAL, _INFEASIBLE, _OVERDETERMINED = 1, -1, -6


class DaqpSolver:
    """Solves each problem from an empty working set, so that the answer depends on it alone.

    Starting from the last active set gains little at this size (measured with 7 unknowns and 20
    rows of which up to four are active: 4 to 5 us in both cases), and it carries flags over: a row
    that was an equality, or zero, or active at a bound that is infinite now spoils later answers.

    Rows need a common scale: DAQP takes a row for zero when its length in the metric of P,
    sqrt(a P^-1 a'), is below 3e-6. Bounds that cross by less than 1e-9 count as equal.
    """

    def __init__(self, n: int, m: int) -> None:
        """Takes the size of the problems: n unknowns, m rows."""
        self._shape = (m, n)
        self._model: daqp.Model | None = None
        self._inactive = np.zeros(m, dtype=np.intc)
        self._nothing = unsolved(n, m)

    def rebuild(self) -> None:
        """Forgets everything about earlier problems."""
        self._model = None

    def solve(self, problem: QuadraticProgram, *, finite: bool = False) -> Solution:
        """Solves the problem, or says why not; data that are not finite never reach DAQP."""
        if not (finite or problem.is_finite()):
            return self._failed(Status.NOT_FINITE)
        model = self._model
        P, g, A = problem.P, problem.g, problem.A
        if model is None:
            model = self._model = daqp.Model()
            model.settings = SETTINGS
            code, _ = model.setup(P, g, A, problem.upper, problem.lower, self._inactive)
        else:
            code = model.update(P, g, A, problem.upper, problem.lower, self._inactive)
        if code < 0:
            # The model keeps parts of the refused problem.
            self._model = None
            return self._failed(_status(code))
        x, _, code, info = model.solve()
        if code != _OPTIMAL:
            return self._failed(_status(code), info["iterations"])
        if not math.isfinite(x.dot(x)):
            self._model = None
            return self._failed(_without_answer(problem), info["iterations"])
        return Solution(x, info["lam"], Status.SOLVED, info["iterations"])

    def _failed(self, status: Status, iterations: int = 0) -> Solution:
        return Solution(*self._nothing, status, iterations)


def _status(code: int) -> Status:
    """Status of a negative exit flag."""
    if code in (_INFEASIBLE, _OVERDETERMINED):
        return Status.INFEASIBLE
    return Status.NOT_CONVERGED


def _without_answer(problem: QuadraticProgram) -> Status:
    """Why finite data gave no finite answer: a lower bound of +inf, an upper one of -inf."""
    if np.any(problem.lower == math.inf) or np.any(problem.upper == -math.inf):
        return Status.INFEASIBLE
    return Status.NOT_CONVERGED
