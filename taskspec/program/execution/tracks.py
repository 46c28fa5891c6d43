"""Moves and paths of a stage that has been entered: cubics that the tick sees one at a time."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np
from numpy.typing import NDArray

from taskspec.motion.polynomial import PiecewiseCubic
from taskspec.program.stages.stage import CompiledStage

Vector = NDArray[np.float64]


class Tracks:
    """The piecewise cubics of a stage and the next time at which one of them changes.

    Attributes:
        numbers: of the cubics that follow from the entry, which writes them; see `StageEntry`.
        next_knot: stage time [s] of the next change, infinite after the last.
    """

    def __init__(self, stage: CompiledStage, parameters: Vector) -> None:
        """For a stage, on the array of its parameters."""
        entry = stage.entry
        place = {name: parameters[where] for name, where in stage.parameters.slots.items()}
        self.numbers = np.zeros(entry.function.nnz_out(2))
        self._cubics: list[tuple[Vector, PiecewiseCubic]] = []
        self._table: list[tuple[Vector, PiecewiseCubic]] = []
        self._knots, self._known, at = [np.inf], [0.0], 0
        for name, count in entry.cubics.items():
            knots, rest = np.split(self.numbers[at : at + 5 * count + 1], [count + 1])
            at += 5 * count + 1
            self._cubics.append((place[name], PiecewiseCubic(knots, rest.reshape(count, 4))))
        self._path = entry.path
        if self._path is not None:
            self._known = self._path.knots()
            self._cubics.append((place["segment.path"], self._path.timing))
            self._table = [(place[f"table.{a}"], s) for a, s in self._path.splines.items()]
        self.next_knot = np.inf

    @property
    def duration(self) -> float:
        """Stage time [s] at which all of them are done."""
        return max((float(cubic.rests) for _, cubic in self._cubics), default=0.0)

    def begin(self) -> None:
        """Takes up the numbers of an entry, which has written the pieces that hold at time 0."""
        if not self._cubics:
            return
        knots = [*self._known]
        for _, cubic in self._cubics:
            knots += cubic.knots.tolist()
        knots.sort()
        self._knots = [*knots, np.inf]
        self._pass(0.0)

    def refresh(self, t: float) -> None:
        """Writes the pieces that hold at stage time t [s] into the parameters."""
        for place, cubic in self._cubics:
            place[:] = cubic.segment(t)
        if self._path is not None:
            s = self._path.timing(t)
            for place, spline in self._table:
                place[:] = spline.segment(s)
        self._pass(t)

    def _pass(self, t: float) -> None:
        self.next_knot = self._knots[bisect_right(self._knots, t)]
