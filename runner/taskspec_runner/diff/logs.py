"""Two logs tick by tick: the first tick at which they part, and how far columns come apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from taskspec_runner.export.source import Source

_STAGE = "stage"


@dataclass(slots=True)
class Apart:
    """A column that differs between two logs.

    Attributes:
        name, unit: of the column. tick: the first at which it differs. clock: of that tick [s].
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
        only: columns that only A has, and only B. stages: at the tick at which they part.
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


def diff_logs(a: Source | None, b: Source | None) -> LogDifference:
    """Holds the logs of two runs against each other, some thousand ticks at a time.

    Values are the same if they are equal, or if there is none in both.
    """
    if a is None or b is None:
        ticks = tuple(0 if s is None else sum(c.num_rows for c in s.chunks()) for s in (a, b))
        return LogDifference((ticks[0], ticks[1]))
    names = [name for name in a.schema.names if name in b.schema.names]
    only = tuple([n for n in x.schema.names if n not in names] for x in (a, b))
    found: dict[str, Apart] = {}
    stages, common, rest = ("", ""), 0, (0, 0)
    for left, right in _pairs(a, b):
        if left is None or right is None:
            counts = (0 if side is None else side.num_rows for side in (left, right))
            rest = (rest[0] + next(counts), rest[1] + next(counts))
            continue
        before = len(found)
        for name in names:
            _column(found, name, a.units[name], (left, right), common)
        if found and not before:
            row = min(each.tick for each in found.values()) - common
            stages = (_at(left, _STAGE, row), _at(right, _STAGE, row))
        common += left.num_rows
    apart = sorted(
        found.values(), key=lambda each: (each.tick, _rank(each.name), names.index(each.name))
    )
    return LogDifference((common + rest[0], common + rest[1]), apart, (only[0], only[1]), stages)


def _rank(name: str) -> int:
    """What is wanted comes before what follows from it in the same tick."""
    return 0 if name == _STAGE else 1 if name.endswith(".ref") else 2


def _column(
    found: dict[str, Apart],
    name: str,
    unit: str,
    sides: tuple[pa.RecordBatch, pa.RecordBatch],
    before: int,
) -> None:
    """Notes how a column differs in a stretch of both logs that begins at tick `before`."""
    x, y = (_values(side.column(name)) for side in sides)
    differs = x != y
    numbers = x.dtype.kind == "f"
    if numbers:
        differs &= ~(np.isnan(x) & np.isnan(y))
    rows = np.flatnonzero(differs)
    if not len(rows):
        return
    clock = sides[0].column("clock").to_numpy()
    if name not in found:
        row = int(rows[0])
        values = (_plain(x[row]), _plain(y[row]))
        found[name] = Apart(name, unit, before + row, float(clock[row]), values)
    if not numbers:
        return
    sizes = np.abs(x[rows] - y[rows])
    if np.isnan(sizes).all():
        return
    most = int(np.nanargmax(sizes))
    if not sizes[most] <= found[name].largest:
        found[name].largest, found[name].at = float(sizes[most]), float(clock[rows[most]])


def _pairs(a: Source, b: Source) -> Iterator[tuple[pa.RecordBatch | None, pa.RecordBatch | None]]:
    """Stretches of both logs of the same length; at the end, what only one of them has."""
    sides: list[Iterator[pa.RecordBatch]] = [a.chunks(), b.chunks()]
    held: list[pa.RecordBatch | None] = [next(side, None) for side in sides]
    while any(batch is not None for batch in held):
        left, right = held
        if left is None or right is None:
            yield left, right
            held = [None if h is None else next(s, None) for h, s in zip(held, sides, strict=True)]
            continue
        rows = min(left.num_rows, right.num_rows)
        yield left.slice(0, rows), right.slice(0, rows)
        held = [
            h.slice(rows) if h.num_rows > rows else next(side, None)
            for h, side in zip((left, right), sides, strict=True)
        ]


def _values(column: pa.Array) -> NDArray[Any]:
    if pa.types.is_dictionary(column.type):
        return np.array(column.to_pylist(), dtype=np.str_)
    return np.asarray(column.to_numpy(zero_copy_only=False))


def _plain(value: Any) -> float | str | None:
    if isinstance(value, str):
        return str(value)
    return float(value) if np.isfinite(value) else None


def _at(batch: pa.RecordBatch, name: str, row: int) -> str:
    return str(batch.column(name)[row].as_py())
