"""Solvers by the name that a task file gives them."""

from __future__ import annotations

from taskspec.control.qp.quadratic_program import Solver
from taskspec.missing import require

SOLVERS = ("daqp", "osqp")


def check_solver(name: str) -> None:
    """Finds out whether a solver can be made.

    Raises:
        MissingLibraryError: its library is not installed.
    """
    if name == "osqp":
        require("osqp", "solver: osqp", "scipy")


def make_solver(name: str, n: int, m: int) -> Solver:
    """A solver for problems of n unknowns and m rows.

    Each library is imported at its first use: osqp takes longer to import than a task
    to compile.

    Raises:
        ValueError: no solver has this name.
    """
    if name == "daqp":
        from taskspec.control.qp.daqp import DaqpSolver

        return DaqpSolver(n, m)
    if name == "osqp":
        from taskspec.control.qp.osqp import OsqpSolver

        return OsqpSolver(n, m)
    raise ValueError(f"unknown solver {name!r}; known are {', '.join(SOLVERS)}")
