"""Functions of CasADi by its virtual machine and as machine code, on the same memory."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.native.engine import Engine
from taskspec.native.expressions import expression_ir
from taskspec.native.interpreter import INTERPRET, interpreted, interpreter_ir
from taskspec.store import Store

Array = NDArray[np.float64]

# What neither writes stays this.
UNTOUCHED = 7.5
NOTHING = Store(None)

SIGNATURE = (*[ctypes.c_void_p] * 4, ctypes.c_int)
EVALUATE = ctypes.CFUNCTYPE(ctypes.c_int, *SIGNATURE)

#: Evaluates a function from arrays into arrays, where None stands for NULL.
Evaluate = Callable[[Sequence[Array | None], Sequence[Array | None]], None]


def arrays(sizes: Sequence[int]) -> list[Array]:
    return [np.full(max(1, size), UNTOUCHED) for size in sizes]


def outputs_of(function: ca.Function) -> list[Array]:
    return arrays([function.nnz_out(k) for k in range(function.n_out())])


def pointers(memory: Sequence[Array | None]) -> ctypes.Array:
    return (ctypes.c_void_p * max(1, len(memory)))(
        *[None if part is None else part.ctypes.data for part in memory]
    )


def own_code(function: ca.Function, level: int = 1) -> Evaluate:
    """A function as machine code of its own."""
    code = Engine([expression_ir(function, "f")], level=level, store=NOTHING)
    run = code.function("f", ctypes.c_int, *SIGNATURE)

    def evaluate(given: Sequence[Array | None], results: Sequence[Array | None]) -> None:
        assert run(pointers(given), pointers(results), None, None, 0) == 0

    return evaluate


@cache
def interpreter() -> Engine:
    return Engine([interpreter_ir()], store=NOTHING)


def by_interpreter(function: ca.Function, engine: Engine | None = None) -> Evaluate:
    """A function by the interpreter."""
    prepared = interpreted(function, engine or interpreter())
    run = prepared.engine.function(INTERPRET, ctypes.c_int, *SIGNATURE)
    work = prepared.work.copy()

    def evaluate(given: Sequence[Array | None], results: Sequence[Array | None]) -> None:
        code = prepared.runs.ctypes.data
        assert run(pointers(given), pointers(results), code, work.ctypes.data, 0) == 0

    return evaluate


TIERS = {"own code": own_code, "interpreter": by_interpreter}


def virtual(
    function: ca.Function, given: Sequence[Array | None], results: Sequence[Array | None]
) -> None:
    """Runs CasADi's virtual machine from and into these arrays."""
    buffer, evaluate = function.buffer()
    for k, part in enumerate(given):
        if part is not None:
            buffer.set_arg(k, memoryview(part))
    for k, part in enumerate(results):
        if part is not None:
            buffer.set_res(k, memoryview(part))
    evaluate()


def bits(values: Array) -> list[int]:
    """The bits of numbers, all NaN being one."""
    return np.where(np.isnan(values), np.nan, values).view(np.uint64).tolist()
