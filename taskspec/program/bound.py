"""A CasADi function with its arguments and results in place."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

#: Rows that are evaluated at a time.
CHUNK = 128


class BoundFunction:
    """Evaluates a function on arrays that are given once.

    Attributes:
        evaluate: reads the arguments, writes the results.
    """

    def __init__(
        self, function: ca.Function, arguments: Sequence[Vector], results: Sequence[Vector]
    ) -> None:
        """Binds 1-D contiguous arrays, in the function's order."""
        self._buffer, self.evaluate = function.buffer()
        # The buffer keeps addresses, not references: everything it sees must outlive it.
        self._kept = [*arguments, *results]
        for i, array in enumerate(arguments):
            self._buffer.set_arg(i, array.data)
        for i, array in enumerate(results):
            self._buffer.set_res(i, array.data)


def over_rows(function: ca.Function, *arguments: Vector) -> tuple[Vector, ...]:
    """A function at many ticks at once.

    Args:
        function: of dense column vectors.
        arguments: (n, size) of each, a row for every tick.

    Returns:
        (n, size) of each result.
    """
    n = len(arguments[0])
    chunk = max(min(n, CHUNK), 1)
    padded = -(-n // chunk) * chunk
    given = [np.zeros((padded, argument.shape[1])) for argument in arguments]
    for array, argument in zip(given, arguments, strict=True):
        array[:n] = argument
    results = [np.empty((padded, function.nnz_out(i))) for i in range(function.n_out())]
    # Mapping over all rows at once would take longer than evaluating them.
    mapped = function.map(chunk)
    for start in range(0, padded, chunk):
        rows = slice(start, start + chunk)
        here = [[array[rows].reshape(-1) for array in arrays] for arrays in (given, results)]
        bound = BoundFunction(mapped, *here)
        bound.evaluate()
    return tuple(result[:n] for result in results)
