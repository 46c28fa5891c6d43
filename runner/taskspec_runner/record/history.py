"""A run read back from its log: columns, and which ticks belong to which stage."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Visit:
    """One visit of a stage: rows `first` to `last`, both included."""

    stage: str
    first: int
    last: int

    @property
    def rows(self) -> slice:
        """The rows of the visit."""
        return slice(self.first, self.last + 1)


@dataclass(frozen=True, slots=True)
class History:
    """Every tick of a run, one row each, in SI units.

    Attributes:
        columns: (n,) of every signal, by its name in the log; NaN where it has no value.
        stages: (n,) the stage of each row.
        units: of the columns, as the log states them.
    """

    columns: Mapping[str, Vector]
    stages: NDArray[np.str_]
    units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.stages)

    def window(self, stage: str | None) -> Mask:
        """(n,) The rows of all visits of a stage, or every row for None."""
        if stage is None:
            return np.ones(len(self), dtype=bool)
        return np.asarray(self.stages == stage)

    def visits(self) -> Iterator[Visit]:
        """Each visit of a stage, in order; a stage that follows itself is visited anew."""
        if not len(self):
            return
        t = self.columns["t"]
        new = (self.stages[1:] != self.stages[:-1]) | (t[1:] <= t[:-1])
        starts = np.flatnonzero(np.concatenate([[True], new]))
        ends = np.append(starts[1:], len(self)) - 1
        for first, last in zip(starts.tolist(), ends.tolist(), strict=True):
            yield Visit(str(self.stages[first]), first, last)


def stream_log(path: Path) -> Iterator[pa.RecordBatch]:
    """The batches of a log one by one; of one that was cut short, up to its last complete batch.

    Raises:
        OSError: the file cannot be opened.
    """
    with path.open("rb") as file:
        reader = None
        while True:
            try:
                reader = reader or pa.ipc.open_stream(file)
                batch = reader.read_next_batch()
            except (StopIteration, pa.ArrowInvalid, OSError):
                # The end of the stream, or of what a killed run has left of it.
                return
            yield batch


def read_history(path: Path) -> History:
    """Reads a log back; one that was cut short, up to its last complete batch.

    Raises:
        OSError: the file cannot be opened.
    """
    batches = list(stream_log(path))
    if not batches:
        return History({}, np.array([], dtype=np.str_))
    table = pa.Table.from_batches(batches)
    columns = {name: table[name].to_numpy() for name in table.column_names if name != "stage"}
    return History(columns, np.array(table["stage"].to_pylist(), dtype=np.str_), units_of(table))


def units_of(table: pa.Table | pa.RecordBatch) -> dict[str, str]:
    """The unit of each column, as the log states it."""
    return {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in table.schema}
