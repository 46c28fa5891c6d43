"""Which generalised coordinates the constraints of a stage decide, (4.80), chosen as it runs.

Around a full circle no fixed choice survives: every coordinate's share of the gradient changes its
sign once. So the choice is made again before it degrades. The acceleration that the old choice
asked for is held, and fades, so that the torque does not jump.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.slots import Slots
from taskspec.program.stages.candidates import Choice

Vector = NDArray[np.float64]

#: More exchanges than this are rounding.
_EXCHANGES = 50
#: In the place of a pivot of 0, where the constraints depend on each other.
_TINY = 1e-300


class Chooser:
    """Chooses the coordinates of a stage, on the arrays of its tick."""

    def __init__(self, choice: Choice, parameters: Slots, arguments: Sequence[Vector]) -> None:
        """For a stage.

        Args:
            choice: of the stage.
            parameters: their layout.
            arguments: of its tick, the parameters last.
        """
        look, slots, held = choice.look, parameters.slots, arguments[-1]
        results = [np.zeros(look.nnz_out(i)) for i in range(3)]
        self._look = BoundFunction(look, arguments, results)
        flat, self._wanted, self._kept = results
        self._gradient = flat.reshape(look.size_out(0), order="F")
        self._selection, self._held = held[slots["selection"]], held[slots["held"]]
        self._chosen_at = held[slots["chosen_at"]]

    def first(self) -> None:
        """Chooses at entry."""
        self._look.evaluate()
        self._choose()

    def again(self, t: float) -> None:
        """Chooses at stage time t [s] and holds what the last choice asked for at these inputs."""
        self._look.evaluate()
        self._choose()
        # Of an acceleration that keeps the constraints, elimination changes nothing.
        self._held[:] = self._kept - self._wanted
        self._chosen_at[:] = t

    def _choose(self) -> None:
        coordinates = self._gradient.shape[1]
        self._selection[:] = 0.0
        for i, j in enumerate(choose(self._gradient.tolist())):
            self._selection[coordinates * i + j] = 1.0


def choose(rows: list[list[float]]) -> list[int]:
    """The m columns of a matrix (m, c) whose minor is large.

    Elimination with the largest pivots gives a first choice; then columns are exchanged as long as
    that makes the minor larger. The rows hold the matrix by its chosen columns, B^-1 A, whose
    elements are what an exchange makes of the minor. They are so few that numbers are faster than
    arrays.

    Args:
        rows: of the matrix; they are changed.
    """
    chosen = [0] * len(rows)
    left = list(range(len(rows)))
    while left:
        i, j, _ = _largest(rows, left)
        left.remove(i)
        chosen[i] = j
        _eliminate(rows, i, j)
    for _ in range(_EXCHANGES):
        i, j, gain = _largest(rows, range(len(rows)))
        if not gain >= 1 + 1e-6:
            break
        chosen[i] = j
        _eliminate(rows, i, j)
    return chosen


def _largest(rows: list[list[float]], among: Sequence[int]) -> tuple[int, int, float]:
    """Row and column of the largest element of some rows, and its size."""
    at, column, most = among[0], 0, -1.0
    for i in among:
        for j, value in enumerate(rows[i]):
            if abs(value) > most:
                at, column, most = i, j, abs(value)
    return at, column, most


def _eliminate(rows: list[list[float]], i: int, j: int) -> None:
    """Makes column j a unit vector whose 1 is in row i."""
    pivot = rows[i][j] or _TINY
    rows[i] = own = [value / pivot for value in rows[i]]
    for k, row in enumerate(rows):
        if k != i and row[j] != 0.0:
            share = row[j]
            rows[k] = [value - share * part for value, part in zip(row, own, strict=True)]
