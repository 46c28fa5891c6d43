"""When the samples of a log were recorded: times that rise, each of them once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.errors import InputError
from taskspec_runner.record.file_array import in_file

Vector = NDArray[np.float64]

#: How several samples with one stamp become one.
LAST, FIRST, MEAN = "last", "first", "mean"


class Stamps:
    """The times of samples, and what becomes of samples that share one.

    Attributes:
        times: (m,) rising [s].
        samples: how many were recorded, n >= m.
    """

    def __init__(
        self, times: Vector, place: Callable[[int], str], what: str, repeated: str | None = None
    ) -> None:
        """Takes the times of all samples.

        Args:
            times: (n,) since the log begins [s].
            place: row -> where it stands, in words.
            what: they are the times of.
            repeated: `last`, `first` or `mean`, of several samples with one stamp.

        Raises:
            InputError: a time is missing, or does not rise.
        """
        self._place, self.samples, self._repeated = place, len(times), repeated
        if not np.isfinite(times).all():
            row = int(np.flatnonzero(~np.isfinite(times))[0])
            raise InputError(f"{what}: there is no time in {place(row)}")
        steps = np.diff(times)
        wrong = np.flatnonzero(steps < 0 if repeated else steps <= 0)
        if len(wrong):
            row = int(wrong[0]) + 1
            now, before = (f"{round(float(t), 6):.9g} s" for t in (times[row], times[row - 1]))
            often = f" ({len(wrong)} times in all)" if len(wrong) > 1 else ""
            hint = "sort the file by its time"
            if times[row] == times[row - 1]:
                hint = "say which sample of a stamp counts: repeated: last, first or mean"
            raise InputError(
                f"{what}: time does not rise in {place(row)}: {now} after {before}, counted from "
                f"the first sample{often}; {hint}"
            )
        #: (m,) first sample of each stamp; None where each sample has its own.
        self._first: NDArray[np.int64] | None = None
        self.times = times
        if repeated is not None and (steps == 0).any():
            new = np.asarray(np.flatnonzero(steps > 0) + 1)
            self._first = in_file(np.concatenate([[0], new]))
            self.times = in_file(np.asarray(times[self._first]))

    def place(self, row: int) -> str:
        """Where the first sample of a stamp stands, in words."""
        return self._place(row if self._first is None else int(self._first[row]))

    def one_each(self, values: Vector) -> Vector:
        """(m,) one value for each time; a mean leaves out what has no value.

        Args:
            values: (n,) of all samples, NaN where there is none.
        """
        if self._first is None:
            return values
        if self._repeated != MEAN:
            return self.chosen(values)
        known = ~np.isnan(values)
        count = np.add.reduceat(np.asarray(known, dtype=float), self._first)
        total = np.add.reduceat(np.asarray(np.where(known, values, 0.0)), self._first)
        with np.errstate(invalid="ignore"):
            return in_file(np.asarray(total / np.where(count > 0, count, np.nan)))

    def chosen(self, values: NDArray[Any]) -> NDArray[Any]:
        """(m,) the first or the last value of each time; of what has no mean, the last."""
        if self._first is None:
            return values
        if self._repeated == FIRST:
            return in_file(np.asarray(values[self._first]))
        last = np.append(np.asarray(self._first[1:]), self.samples) - 1
        return in_file(np.asarray(values[last]))
