"""The dual active-set method in machine code, on the arrays of one problem: a tick's first try."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from types import ModuleType

import numpy as np

from taskspec.control.qp.quadratic_program import Array, QuadraticProgram
from taskspec.native import quadratic
from taskspec.native.engine import Engine, available
from taskspec.native.kernel import Record
from taskspec.native.kernel_ir import kernel_ir, kernel_source
from taskspec.native.quadratic import Workspace, workspace


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
        self._solve = by_code(quadratic.solve, quadratic)
        self.workspace = sharing(problem)
        self.x: Array = np.asarray(self.workspace.x)
        self.dual: Array = np.asarray(self.workspace.y)

    def solve(self) -> int:
        """Writes x and dual, the answer where it returns SOLVED; see `quadratic.solve`."""
        return self._solve(self.workspace)


def sharing(problem: QuadraticProgram) -> Workspace:
    """A workspace on the arrays of a problem."""
    program = workspace(*reversed(problem.A.shape))
    for name in ("flat_P", "g", "flat_A", "lower", "upper"):
        setattr(program, name.removeprefix("flat_"), getattr(problem, name))
    return program


def dual_solver(problem: QuadraticProgram) -> DualSolver | None:
    """The solver of a problem; None where there is no machine code."""
    return DualSolver(problem) if available() else None


@cache
def by_code(kernel: Callable[..., int], *modules: ModuleType) -> Callable[..., int]:
    """A kernel of records as machine code, compiled at once; itself where there is none.

    An answer must not depend on what is kept.

    Args:
        kernel: of records, which returns an int.
        modules: as in `kernel_source`.
    """
    if not available():
        return kernel
    source = kernel_source(*modules)
    engine = Engine(lambda: [kernel_ir(kernel)], level=2, source=source)
    count = kernel.__code__.co_argcount
    called = engine.function(kernel.__name__, ctypes.c_int64, *[ctypes.c_void_p] * count)

    def by_addresses(*records: Record) -> int:
        return int(called(*(record.address for record in records)))

    return by_addresses
