"""A CasADi function with its arguments and results in place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Protocol

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.evaluation_order import grouped, is_grouped

Vector = NDArray[np.float64]

#: Rows that are evaluated at a time.
CHUNK = 128
#: Rows from which on machine code is made: to load what makes it takes a tenth of a second.
_MANY = 10_000


class Addresses(Protocol):
    """Machine code, for as long as it lives."""

    def address(self, name: str) -> int:
        """Address of a function."""


class BoundFunction:
    """Evaluates a function on arrays that are given once.

    Attributes:
        function: what is evaluated.
        arguments, results: 1-D arrays, in the function's order.
        evaluate: reads the arguments, writes the results.
        code: whose address is the function's machine code; None where it has none.
    """

    def __init__(
        self, function: ca.Function, arguments: Sequence[Vector], results: Sequence[Vector]
    ) -> None:
        """Binds 1-D contiguous arrays, in the function's order.

        Raises:
            ValueError: an array is shorter than what the function reads or writes there.
        """
        _fit(function, arguments, results)
        self.evaluate: Callable[[], Any]
        self.code: Addresses | None = None
        self._grouped = self._foreign = False
        # The buffer keeps addresses, not references: everything it sees must outlive it.
        self.function, self.arguments, self.results = function, (*arguments,), (*results,)
        self._bind(function, 0)

    def _bind(self, function: ca.Function, skipped: int) -> None:
        """Has `function` evaluated, the first of whose results nobody wants."""
        self._buffer, self.evaluate = function.buffer()
        for i, array in enumerate(self.arguments):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(self.results):
            self._buffer.set_res(i + skipped, array.data)

    @property
    def groups(self) -> bool:
        """Whether its instructions are grouped, or have been for the same function elsewhere."""
        return self._grouped or is_grouped(self.function)

    def group(self) -> None:
        """Evaluates in an order that takes less time from now on, with the same bits.

        To find it takes as long as some hundred evaluations.
        """
        if not (self._grouped or self._foreign) and self.function.is_a("SXFunction"):
            self._grouped = True
            self._bind(grouped(self.function), 1)

    def evaluate_by(self, called: Callable[..., Any], *memory: NDArray[Any]) -> None:
        """Has other code evaluate the function from now on, with the same bits.

        Args:
            called: takes the addresses of the addresses of arguments and results, two more, and a
                number of no meaning, as CasADi's generated code does.
            memory: what lies at those two, if they are of any meaning.
        """
        places = [
            np.array([array.ctypes.data for array in arrays], dtype=np.int64)
            for arrays in (self.arguments, self.results)
        ]
        given = [array.ctypes.data for array in (*places, *memory)]
        self._foreign, self._kept = True, (places, memory)  # as the buffer, it keeps addresses
        self.evaluate = partial(called, *given, *[0] * (5 - len(given)))


def _fit(function: ca.Function, arguments: Sequence[Vector], results: Sequence[Vector]) -> None:
    """Refuses arrays beyond whose ends a function would read or write."""
    read = [function.nnz_in(i) for i in range(function.n_in())]
    written = [function.nnz_out(i) for i in range(function.n_out())]
    for what, sizes, arrays in (("argument", read, arguments), ("result", written, results)):
        given = [array.size for array in arrays]
        contiguous = all(array.flags.c_contiguous for array in arrays)
        # What a derivative does not read of an argument it has no numbers of.
        short = any(have < need for have, need in zip(given, sizes, strict=True))
        if short or not contiguous:
            raise ValueError(f"{function.name()}: {what}s of {sizes} numbers, given {given}")


class Wiring:
    """A function while it is put together, each argument and result with its memory."""

    def __init__(self) -> None:
        self._arguments: list[tuple[ca.SX, Vector]] = []
        self._results: list[tuple[ca.SX, Vector]] = []

    def reads(self, name: str, array: Vector) -> ca.SX:
        """(size,) symbol of what lies in a 1-D contiguous `array` whenever it is evaluated."""
        symbol = ca.SX.sym(name, array.size)
        self._arguments.append((symbol, array))
        return symbol

    def numbers(self, name: str, *values: float) -> ca.SX:
        """(size,) symbol of numbers of this world alone, so that all worlds have the same code."""
        return self.reads(name, np.array(values, dtype=np.float64))

    def writes(self, value: ca.SX, array: Vector) -> None:
        """Has the function write `value` (size,) into a 1-D contiguous `array`."""
        self._results.append((ca.densify(value), array))

    def bound(self, name: str, *, cse: bool = True) -> BoundFunction:
        """The function, on its memory; `cse` has it compute once what comes more than once."""
        symbols, given = zip(*self._arguments, strict=True)
        values, results = zip(*self._results, strict=True)
        return BoundFunction(ca.Function(name, symbols, values, {"cse": cse}), given, results)


def evaluated(function: ca.Function, *arguments: Vector) -> list[Vector]:
    """The results of a function of dense vectors, each (size,), column after column.

    It is what a call of the function gives, without the matrices that a call makes of all arrays.

    Args:
        function: of dense arguments.
        arguments: 1-D arrays, in the function's order.
    """
    given = [np.ascontiguousarray(argument, dtype=np.float64) for argument in arguments]
    results = [np.empty(function.nnz_out(i)) for i in range(function.n_out())]
    bound = BoundFunction(function, given, results)
    bound.evaluate()
    for i, nonzero in enumerate(results):
        if nonzero.size != function.numel_out(i):
            results[i] = np.zeros(function.numel_out(i))
            results[i][function.sparsity_out(i).find()] = nonzero
    return results


class RowFunction:
    """A function of one tick, evaluated at many ticks at once."""

    def __init__(self, function: ca.Function) -> None:
        """Takes a function of dense column vectors."""
        self._function = function
        self._code: Callable[[Vector], Vector | None] | None = None
        self._bound: dict[int, tuple[BoundFunction, list[Vector], list[Vector]]] = {}

    def __call__(self, *arguments: Vector) -> tuple[Vector, ...]:
        """(n, size) of each result, from (n, size) of each argument: a row for every tick.

        Many rows are evaluated by machine code as soon as there is some, to the same bits.
        """
        function, n = self._function, len(arguments[0])
        found = self._by_code(arguments) if n >= _MANY else None
        if found is not None:
            return found
        values = tuple(np.empty((n, function.nnz_out(i))) for i in range(function.n_out()))
        # Mapping over all rows at once would take longer than evaluating them.
        chunk = max(min(n, CHUNK), 1)
        bound, given, results = self._of_size(chunk)
        for start in range(0, n, chunk):
            rows = slice(start, min(start + chunk, n))
            for array, argument in zip(given, arguments, strict=True):
                array[: rows.stop - start] = argument[rows]
            bound.evaluate()
            for array, result in zip(values, results, strict=True):
                array[rows] = result[: rows.stop - start]
        return values

    def _by_code(self, arguments: Sequence[Vector]) -> tuple[Vector, ...] | None:
        """The same by machine code; None as long as there is none."""
        function = self._function
        if self._code is None:
            from taskspec.native.rows import RowCode

            given = [ca.SX.sym("x", function.sparsity_in(i)) for i in range(function.n_in())]
            results = [x for result in function.call(given) for x in result.nonzeros()]
            row = ca.vertcat(*given)
            self._code = RowCode(ca.Function("rows", [row], [ca.vertcat(*results)]))
        found = self._code(np.hstack(arguments))
        if found is None:
            return None
        ends = np.cumsum([function.nnz_out(i) for i in range(function.n_out())])
        return tuple(np.ascontiguousarray(part) for part in np.split(found, ends[:-1], axis=1))

    def _of_size(self, chunk: int) -> tuple[BoundFunction, list[Vector], list[Vector]]:
        """The function of so many rows, with its arguments and results (chunk, size) in place."""
        if chunk not in self._bound:
            function = self._function
            given = [np.zeros((chunk, function.nnz_in(i))) for i in range(function.n_in())]
            results = [np.empty((chunk, function.nnz_out(i))) for i in range(function.n_out())]
            flat = [[array.reshape(-1) for array in arrays] for arrays in (given, results)]
            self._bound[chunk] = BoundFunction(function.map(chunk), *flat), given, results
        return self._bound[chunk]
