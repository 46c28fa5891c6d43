"""A CasADi function with its arguments and results in place."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


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
