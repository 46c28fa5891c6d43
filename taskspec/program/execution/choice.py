"""Choice of the generalised coordinates that constraints decide, (4.80), as a stage runs.

Around a full circle no fixed choice survives: every coordinate's share of the gradient changes its
sign once. So the choice is made again before it degrades. The acceleration that the old choice
commanded is held, and fades, so that the torque does not jump.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import BoundFunction
from taskspec.program.slots import Slots
from taskspec.program.stages.candidates import Choice

Vector = NDArray[np.float64]


class Chooser:
    """Chooses the coordinates of a stage, on the arrays of its tick.

    Attributes:
        look: writes the constraints' gradient and what is commanded to the coordinates.
        gradient: (m c,) of the m constraints by the c coordinates, column by column.
        wanted, kept: (n,) what is commanded, and of that what keeps the constraints.
        selection: (m c,) of the tick's parameters, row by row.
        held: (n,) of the tick's parameters: what the last choice commanded beside this one.
        chosen_at: (1,) of them: when this choice was made [s].
        sizes: m and c.
        rows, chosen, left: memory of the choice; see `pivots.select`.
    """

    def __init__(self, choice: Choice, parameters: Slots, arguments: Sequence[Vector]) -> None:
        """For a stage.

        Args:
            choice: of the stage.
            parameters: their layout.
            arguments: of its tick, the parameters last.
        """
        look, slots, held = choice.look, parameters.slots, arguments[-1]
        results = [np.zeros(look.nnz_out(i)) for i in range(3)]
        self.look = BoundFunction(look, arguments, results)
        self.gradient, self.wanted, self.kept = results
        self.sizes: tuple[int, int] = look.size_out(0)
        self.selection, self.held = held[slots["selection"]], held[slots["held"]]
        self.chosen_at = held[slots["chosen_at"]]
        self.rows = np.zeros(self.gradient.size)
        self.chosen, self.left = np.zeros((2, self.sizes[0]), dtype=np.int64)

    def first(self) -> None:
        """Chooses at entry."""
        self.look.evaluate()
        self._choose()

    def again(self, t: float) -> None:
        """Chooses at stage time t [s] and holds what the last choice commanded at these inputs."""
        self.look.evaluate()
        self._choose()
        # Of an acceleration that keeps the constraints, elimination changes nothing.
        self.held[:] = self.kept - self.wanted
        self.chosen_at[:] = t

    def _choose(self) -> None:
        # What a kernel is written with takes time to import; most tasks have no constraints.
        from taskspec.native.kernel import vector
        from taskspec.program.execution.pivots import select

        select(
            vector(self.gradient),
            vector(self.selection),
            vector(self.rows),
            vector(self.chosen),
            vector(self.left),
            *self.sizes,
        )
