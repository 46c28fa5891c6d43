"""A function of CasADi on its memory, as kernels call it."""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from taskspec.native.code import (
    CODE,
    Compiling,
    NotReadyError,
    expression_engine,
    interpreter_engine,
)
from taskspec.native.interpreter import INTERPRET, interpreted
from taskspec.native.kernel import Record, call
from taskspec.program.bound import BoundFunction

Array = NDArray[np.float64]
#: What a function of CasADi's takes: arguments, results, and three that are not used.
_SIGNATURE = (ctypes.c_void_p,) * 4 + (ctypes.c_int,)


class Evaluation(Record):
    """A function of CasADi on its memory, as machine code or by the interpreter.

    What is called takes the addresses of the addresses of arguments and results, and two that only
    the interpreter takes: of its instructions and of the work vector.

    Attributes:
        bound: the function, on Python's arrays; None for none.
        arrays: of its arguments, and of its results.
    """

    code: int  # the address of what is called, 0 for none
    arguments: int
    results: int
    instructions: int
    work: int

    def __init__(
        self, bound: BoundFunction | None = None, instead: Sequence[tuple[Array, Array]] = ()
    ) -> None:
        """Takes the function, None for none; `instead` has pairs of its arrays and ours."""
        super().__init__()
        self.bound = bound
        if bound is None:
            return
        ours = {id(theirs): array for theirs, array in instead}
        self.arrays = [
            [ours.get(id(array), array) for array in arrays]
            for arrays in (bound.arguments, bound.results)
        ]
        self._places = [
            np.array([array.ctypes.data for array in arrays], dtype=np.int64)
            for arrays in self.arrays
        ]
        self.arguments, self.results = (places.ctypes.data for places in self._places)

    def load(self, compiling: Compiling) -> bool:
        """Takes the function's own machine code; returns whether there is some."""
        bound = self.bound
        if bound is None:
            return True
        if bound.code is None:
            try:
                engine = expression_engine(bound.function, compiling)
            except NotReadyError:
                return False
            bound.code = engine
            # Ticks that are left to Python take the same code.
            bound.evaluate_by(engine.function(CODE, None, *_SIGNATURE, brief=True))
        # The code lives as long as the bound function.
        self.code = bound.code.address(CODE)
        return True

    @property
    def ready(self) -> bool:
        """Whether there is code for the function, if there is a function."""
        return bool(self.code) or self.bound is None

    def interpret(self) -> None:
        """Has the interpreter evaluate the function, where it has no code."""
        bound = self.bound
        if bound is None or self.code:
            return
        engine = interpreter_engine()
        prepared = interpreted(bound.function, engine)
        self._prepared, self._work = prepared, prepared.work.copy()
        self.instructions, self.work = prepared.runs.ctypes.data, self._work.ctypes.data
        self.code = engine.address(INTERPRET)
        called = engine.function(INTERPRET, None, *_SIGNATURE, brief=True)
        bound.evaluate_by(called, prepared.runs, self._work)


def evaluate(f: Evaluation) -> None:
    """Has a function read its arguments and write its results."""
    call(f.code, f.arguments, f.results, f.instructions, f.work, 0)


class Evaluations(Record):
    """A record that has functions, those that a run has none of without code.

    Attributes:
        PROGRAMS: names of functions that many runs never evaluate.
        ONCE: of those that are evaluated once in a stage, so that to prepare them for the
            interpreter never pays.
    """

    PROGRAMS: ClassVar[frozenset[str]] = frozenset()
    ONCE: ClassVar[frozenset[str]] = frozenset()

    def __init__(self, base: Self | None = None) -> None:
        """An empty one, or one that begins as `base` is now."""
        super().__init__()
        if base is not None:
            self._memory = type(base._memory).from_buffer_copy(base._memory)
            self._held = dict(base._held)
            return
        for name in self._names():
            setattr(self, name, Evaluation())

    def take(self, **values: Any) -> None:
        """Sets fields: numbers, and vectors to contiguous arrays, which it keeps."""
        for name, value in values.items():
            setattr(self, name, value)

    def load(self, compiling: Compiling) -> bool:
        """Has functions take their machine code; returns whether all have some.

        Args:
            compiling: what becomes of code that there is not. Where that is compiled, none is left
                unasked for; else it is asked for what each tick evaluates.

        Raises:
            EngineError: there is no machine code here.
            UnsupportedOperationError: a function has an operation that machine code lacks.
        """
        compiled = compiling in (Compiling.WAIT, Compiling.BESIDE)
        wanted = self._names() if compiled else self._each_tick()
        return all([each.load(compiling) for each in self._those(wanted)]) and compiled

    def interpret(self, *, programs: bool) -> None:
        """Has the interpreter evaluate what each tick evaluates and has no code.

        Args:
            programs: whether also that of programs, which many runs never solve.

        Raises:
            EngineError, UnsupportedOperationError: as `load`.
        """
        for each in self._those(sorted(self.PROGRAMS) if programs else self._each_tick()):
            each.interpret()

    def ready(self, names: Iterable[str]) -> bool:
        """Whether there is code for all functions of these names."""
        return all(each.ready for each in self._those(names))

    @classmethod
    def _names(cls) -> list[str]:
        return [name for name, kind in cls.records.items() if kind is Evaluation]

    @classmethod
    def _each_tick(cls) -> list[str]:
        return [name for name in cls._names() if name not in cls.PROGRAMS | cls.ONCE]

    def _those(self, names: Iterable[str]) -> Iterator[Evaluation]:
        return (getattr(self, name) for name in names)
