"""Dense quadratic programs, one per tick, behind one small interface with two solvers."""

from taskspec.control.qp.make import SOLVERS, check_solver, make_solver
from taskspec.control.qp.quadratic_program import (
    QuadraticProgram,
    Solution,
    Solver,
    Status,
    residual,
)

__all__ = [
    "SOLVERS",
    "QuadraticProgram",
    "Solution",
    "Solver",
    "Status",
    "check_solver",
    "make_solver",
    "residual",
]
