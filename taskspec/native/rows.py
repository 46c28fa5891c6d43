"""A function of one row, evaluated at many by machine code: such as signals of logged ticks."""

from __future__ import annotations

import ctypes
import hashlib
import sys
from collections import Counter
from collections.abc import Callable

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.native.code import (
    CODE,
    Compiling,
    NotReadyError,
    expression_engine,
    kernel_engine,
)
from taskspec.native.engine import Engine, EngineError
from taskspec.native.expressions import UnsupportedOperationError
from taskspec.native.kernel import Record, Words, call

Rows = NDArray[np.float64]

#: A function whose code is not kept yet is compiled once so many rows have asked for it: that takes
#: as long as some 100 000 rows do without, and worlds of a sweep have functions that are alike.
_WORTH = 20_000
#: By content, the rows that have asked for functions without code; of no more functions than these.
_ASKED: Counter[bytes] = Counter()
_MOST = 1000


class RowMemory(Record):
    """Where the next row is read and written: the addresses that the function takes."""

    function: int
    given_at: int
    made_at: int
    given: Words
    made: Words
    given_step: int
    made_step: int


def evaluate(c: RowMemory, rows: int) -> None:
    """The next rows, one after the other."""
    given, made = c.given, c.made
    for _ in range(rows):
        call(c.function, c.given_at, c.made_at, 0, 0, 0)
        given[0] = given[0] + c.given_step
        made[0] = made[0] + c.made_step


class RowCode:
    """The machine code of a function of one dense vector with one dense result, at many rows."""

    def __init__(self, function: ca.Function) -> None:
        """Takes the function, of SX."""
        self._function, self._content = function, b""
        self._sizes = function.nnz_in(0), function.nnz_out(0)
        self._memory: RowMemory | None = None
        self._run: object = None
        self._lacks = False

    def __call__(self, rows: Rows) -> Rows | None:
        """(k, results) of (k, arguments), contiguous; None as long as there is no code."""
        if not self._ready(len(rows)):
            return None
        given, made = np.ascontiguousarray(rows), np.empty((len(rows), self._sizes[1]))
        c = self._memory
        assert c is not None
        assert callable(self._run)
        c.given[0], c.made[0] = given.ctypes.data, made.ctypes.data
        self._run(c.address, len(rows))
        return made

    def _ready(self, rows: int) -> bool:
        """Whether there is code, for so many rows more."""
        if self._memory is not None or self._lacks:
            return not self._lacks
        if not self._content:
            self._content = hashlib.sha256(self._function.serialize().encode()).digest()
        if len(_ASKED) > _MOST:
            _ASKED.clear()
        _ASKED[self._content] += rows
        worth = _ASKED[self._content] >= _WORTH
        compiling = Compiling.BESIDE if worth else Compiling.NOT_YET
        here = sys.modules[__name__]
        try:
            # Both are asked for at once, so that one is compiled while the other is.
            engine = _if_ready(lambda: expression_engine(self._function, compiling))
            kernel = _if_ready(lambda: kernel_engine(evaluate, here, compiling=compiling))
        except (EngineError, UnsupportedOperationError):
            self._lacks = True
            return False
        if engine is None or kernel is None:
            return False
        places = [np.zeros(1, dtype=np.int64) for _ in range(2)]
        self._memory = RowMemory(
            function=engine.address(CODE),
            given_at=places[0].ctypes.data,
            made_at=places[1].ctypes.data,
            given=places[0],
            made=places[1],
            given_step=8 * self._sizes[0],
            made_step=8 * self._sizes[1],
        )
        # The code lives as long as its engine.
        self._held = engine, places
        self._run = kernel.function(evaluate.__name__, None, ctypes.c_void_p, ctypes.c_int64)
        return True


def _if_ready(ask: Callable[[], Engine]) -> Engine | None:
    """The engine that is asked for; None as long as it is not ready."""
    try:
        return ask()
    except NotReadyError:
        return None
