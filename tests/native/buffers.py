"""Functions of CasADi by its virtual machine and as machine code, on the same memory."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# What neither writes stays this.
UNTOUCHED = 7.5

EVALUATE = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 4, ctypes.c_int)


def arrays(sizes: Sequence[int]) -> list[Array]:
    return [np.full(max(1, size), UNTOUCHED) for size in sizes]


def outputs_of(function: ca.Function) -> list[Array]:
    return arrays([function.nnz_out(k) for k in range(function.n_out())])


def pointers(memory: Sequence[Array | None]) -> ctypes.Array:
    return (ctypes.c_void_p * max(1, len(memory)))(
        *[None if part is None else part.ctypes.data for part in memory]
    )


def machine(address: int, given: Sequence[Array | None], results: Sequence[Array | None]) -> None:
    """Runs machine code from and into these arrays."""
    assert EVALUATE(address)(pointers(given), pointers(results), None, None, 0) == 0


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
