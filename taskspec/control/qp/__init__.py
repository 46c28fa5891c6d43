"""Dense quadratic programs, one per tick, behind one small interface with two solvers."""

from taskspec.control.qp.make import SOLVERS, make_solver
from taskspec.control.qp.problem import Problem, Solution, Solver, Status, residual

__all__ = ["SOLVERS", "Problem", "Solution", "Solver", "Status", "make_solver", "residual"]
