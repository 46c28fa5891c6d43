"""Moves and paths of a stage that has been entered: cubics that the tick sees one at a time."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from taskspec.motion.polynomial import PiecewiseCubic
from taskspec.program.reference.slowed_path import TIME
from taskspec.program.stages.stage import CompiledStage

Vector = NDArray[np.float64]


class Tracks:
    """The piecewise cubics of a stage and the next time at which one of them changes.

    Attributes:
        numbers: of the cubics that follow from the entry, which writes them; see `StageEntry`.
        places: where the knots of each cubic are in there, how many, and whether it is the path's.
        cubic_places: (4 cubics,) the same of each, and the parameter that has its piece.
        known_cubics: the timing of a path that does not follow from the entry, and its tables: of
            each the knots, then the coefficients row after row.
        known_places: (3 known,) of each: where it is in there, its knots, its parameter.
        known: of the path's knots those that do not follow from the entry [s].
        path_time: (1,) of the stage's memory, where signals slow the path: its own time [s].
        next_knot: stage time [s] of the next change, infinite after the last.
    """

    def __init__(self, stage: CompiledStage, parameters: Vector, memory: Vector) -> None:
        """For a stage, on the arrays of its parameters and its memory."""
        entry = stage.entry
        place = {name: parameters[where] for name, where in stage.parameters.slots.items()}
        self.numbers = np.zeros(entry.function.nnz_out(2))
        # Cubics of time; and the path's, which has a time of its own where signals slow it.
        self._cubics: list[tuple[Vector, PiecewiseCubic]] = []
        self._table: list[tuple[Vector, PiecewiseCubic]] = []
        # Made of the numbers at their first use.
        self._knots: list[float] = []
        self._path_knots: list[float] = []
        self.places: list[tuple[int, int, bool]] = []
        known, at = [0.0], 0
        self._along: tuple[Vector, PiecewiseCubic] | None = None
        for name, count in entry.cubics.items():
            knots, rest = np.split(self.numbers[at : at + 5 * count + 1], [count + 1])
            cubic = PiecewiseCubic(knots, rest.reshape(count, 4))
            self.places.append((at, count + 1, name == "segment.path"))
            at += 5 * count + 1
            if name == "segment.path":
                self._along = place[name], cubic
            else:
                self._cubics.append((place[name], cubic))
        if entry.path is not None:
            known += entry.path.knots() + entry.path.timing.knots.tolist()
            self._along = place["segment.path"], entry.path.timing
            self._table = [(place[f"table.{a}"], s) for a, s in entry.path.splines.items()]
        slots = stage.parameters.slots
        names = list(entry.cubics)
        self.cubic_places = np.array(
            [
                (at, count, along, slots[name].start)
                for (at, count, along), name in zip(self.places, names, strict=True)
            ],
            dtype=np.int64,
        ).reshape(-1)
        self.known_cubics, self.known_places = np.zeros(0), np.zeros(0, dtype=np.int64)
        if entry.path is not None:
            tables = {f"table.{a}": spline for a, spline in entry.path.splines.items()}
            self._lay({"segment.path": entry.path.timing, **tables}, slots)
        slot = stage.memory.slots.get(TIME)
        self.path_time = None if slot is None else memory[slot]
        self.known = np.array(sorted(known))
        self.next_knot = np.inf

    def _lay(self, cubics: Mapping[str, PiecewiseCubic], slots: Mapping[str, slice]) -> None:
        """Lays cubics that are known one after the other, by the parameters of their pieces."""
        places: list[tuple[int, int, int]] = []
        numbers: list[Vector] = []
        at = 0
        for name, cubic in cubics.items():
            places.append((at, len(cubic.knots), slots[name].start))
            numbers += [np.asarray(cubic.knots, dtype=np.float64), cubic.coefficients.ravel()]
            at += len(cubic.knots) + cubic.coefficients.size
        self.known_cubics = np.concatenate(numbers)
        self.known_places = np.array(places, dtype=np.int64).reshape(-1)

    @property
    def duration(self) -> float:
        """Stage time [s] at which all of them are done, with a path that nothing slows."""
        along = [] if self._along is None else [self._along]
        return max((float(cubic.rests) for _, cubic in [*self._cubics, *along]), default=0.0)

    def begin(self) -> None:
        """Takes up the numbers of an entry, which has written the pieces that hold at time 0."""
        self.forget()
        self._pass(0.0)

    def forget(self) -> None:
        """Has the numbers of an entry be taken up at their first use."""
        self._knots = []

    def _sort(self) -> None:
        """Puts all knots in their order."""
        knots, path = [0.0], self.known.tolist()
        for at, count, along in self.places:
            (path if along else knots).extend(self.numbers[at : at + count].tolist())
        if self.path_time is None:
            knots, path = knots + path, []
        self._knots, self._path_knots = [*sorted(knots), np.inf], [*sorted(path), np.inf]

    def refresh(self, t: float) -> None:
        """Writes the pieces that hold at stage time t [s] into the parameters."""
        for place, cubic in self._cubics:
            place[:] = cubic.segment(t)
        if self._along is not None:
            place, timing = self._along
            own = t if self.path_time is None else float(self.path_time[0])
            place[:] = timing.segment(own)
            s = timing(own)
            for place, spline in self._table:
                place[:] = spline.segment(s)
        self._pass(t)

    def _pass(self, t: float) -> None:
        if not self._knots:
            self._sort()
        self.next_knot = self._knots[bisect_right(self._knots, t)]
        if self.path_time is not None:
            # No sooner: its time goes at most as fast as that of the stage.
            own = float(self.path_time[0])
            left = self._path_knots[bisect_right(self._path_knots, own)] - own
            self.next_knot = min(self.next_knot, t + left)
