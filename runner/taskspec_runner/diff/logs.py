"""Two logs tick by tick: the first tick at which they part, and how far columns come apart."""

from __future__ import annotations

from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.file_array import blocks
from taskspec_runner.record.history import STAGE, History, Vector


@dataclass(slots=True)
class Apart:
    """A column that differs between two logs.

    Attributes:
        name, unit: of the column.
        tick: the first at which it differs.
        clock: of that tick [s].
        values: in A and B at that tick; None where there is no value.
        largest: size of the largest difference [SI], NaN where never both have a number.
        at: clock of that [s].
    """

    name: str
    unit: str
    tick: int
    clock: float
    values: tuple[float | str | None, float | str | None]
    largest: float = float("nan")
    at: float = float("nan")


@dataclass(slots=True)
class LogDifference:
    """How two logs differ.

    Attributes:
        ticks: of A and B.
        apart: columns in the order of their first difference, what is wanted before the rest.
        only: columns that only A has, and only B.
        stages: at the tick at which they part.
    """

    ticks: tuple[int, int] = (0, 0)
    apart: list[Apart] = field(default_factory=list)
    only: tuple[list[str], list[str]] = field(default_factory=lambda: ([], []))
    stages: tuple[str, str] = ("", "")

    @property
    def equal(self) -> bool:
        """Whether all columns of both have the same values at the same ticks."""
        return not self.apart and not any(self.only) and self.ticks[0] == self.ticks[1]

    @property
    def first(self) -> list[Apart]:
        """The columns that differ at the first tick at which any does."""
        return [each for each in self.apart if each.tick == self.apart[0].tick]


def diff_logs(a: History, b: History) -> LogDifference:
    """Holds the ticks of two runs against each other.

    Values are the same if they are equal, or if there is none in both.
    """
    ticks = (len(a), len(b))
    if not all(ticks):
        return LogDifference(ticks)
    names = [name for name in a.columns if name in b.columns]
    only = tuple([n for n in x.columns if n not in names] for x in (a, b))
    common = min(ticks)
    clock, apart = a.columns["clock"][:common], list[Apart]()
    for name, sides in {
        STAGE: (a.stages, b.stages),
        **{name: (a.columns[name], b.columns[name]) for name in names},
    }.items():
        differs = _apart(name, a.units.get(name, ""), (sides[0][:common], sides[1][:common]), clock)
        if differs is not None:
            apart.append(differs)
    apart.sort(key=lambda each: (each.tick, _rank(each.name)))
    stages = ("", "")
    if apart:
        stages = (str(a.stages[apart[0].tick]), str(b.stages[apart[0].tick]))
    return LogDifference(ticks, apart, (only[0], only[1]), stages)


def _rank(name: str) -> int:
    """What is wanted comes before what follows from it in the same tick."""
    return 0 if name == STAGE else 1 if name.endswith(".ref") else 2


def _apart(
    name: str, unit: str, sides: tuple[NDArray[Any], NDArray[Any]], clock: Vector
) -> Apart | None:
    """How a column differs; None where it does not."""
    found: Apart | None = None
    for part in blocks(len(clock)):
        x, y = (np.asarray(side[part]) for side in sides)
        differs = x != y
        numbers = x.dtype.kind == "f"
        if numbers:
            differs &= ~(np.isnan(x) & np.isnan(y))
        rows = np.flatnonzero(differs)
        if not len(rows):
            continue
        if found is None:
            one, at = int(rows[0]), float(clock[part][rows[0]])
            found = Apart(name, unit, part.start + one, at, (_plain(x[one]), _plain(y[one])))
        sizes = np.abs(x[rows] - y[rows]) if numbers else np.zeros(0)
        if not np.isnan(sizes).all():
            most = int(np.nanargmax(sizes))
            if not found.largest >= sizes[most]:
                found.largest, found.at = float(sizes[most]), float(clock[part][rows[most]])
    return found


def _plain(value: Any) -> float | str | None:
    if isinstance(value, str):
        return str(value)
    return float(value) if np.isfinite(value) else None
