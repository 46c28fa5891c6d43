"""The dual active-set method in machine code, on the arrays of one problem: a tick's first try."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import numpy as np

from taskspec.control.qp.quadratic_program import Array, QuadraticProgram
from taskspec.native import quadratic
from taskspec.native.engine import Engine, available
from taskspec.native.kernel_ir import kernel_ir, kernel_source
from taskspec.native.quadratic import SOLVED, Workspace, workspace


class DualSolver:
    """Solves one problem as often as its arrays are rewritten; what it cannot solve others try.

    Attributes:
        workspace: the problem and its answer, as the kernel has them.
        x: (n,) the last answer; dual: (m,) its multipliers, as in `Solution`.
    """

    def __init__(self, problem: QuadraticProgram) -> None:
        """Takes the problem whose arrays are rewritten.

        Raises:
            EngineError: there is no machine code here.
        """
        m, n = problem.A.shape
        self._solve = _compiled()
        self.workspace: Workspace = workspace(n, m)
        for name in ("flat_P", "g", "flat_A", "lower", "upper"):
            setattr(self.workspace, name.removeprefix("flat_"), getattr(problem, name))
        self.x: Array = np.asarray(self.workspace.x)
        self.dual: Array = np.asarray(self.workspace.y)

    def solve(self) -> bool:
        """Writes x and dual; whether they are the answer."""
        return bool(self._solve(self.workspace.address) == SOLVED)


def dual_solver(problem: QuadraticProgram) -> DualSolver | None:
    """The solver of a problem; None where there is no machine code."""
    return DualSolver(problem) if available() else None


@cache
def _compiled() -> Any:
    """The kernel's `solve`, compiled at once: an answer must not depend on what is kept."""
    source = kernel_source(quadratic)
    engine = Engine(lambda: [kernel_ir(quadratic.solve)], level=2, source=source)
    return engine.function("solve", ctypes.c_int64, ctypes.c_void_p)
