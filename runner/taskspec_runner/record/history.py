"""Every tick of a run: columns, and which ticks belong to which stage."""

from __future__ import annotations

import json
from collections.abc import Container, Iterator, Mapping, Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred import pa
from taskspec.deferred_methods import dataclass
from taskspec.spec.servo import POSITION, TORQUE, VELOCITY
from taskspec_runner.record.file_array import blocks, empty
from taskspec_runner.record.mapped import GrowingColumns

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: The column of the log that names the stage of each tick.
STAGE = "stage"
#: What stands there while an arm is brought to rest after a run. No stage can be called so, as a
#: name has no space.
TO_REST = "to rest"
#: Rows of batches that are put together at once.
_ROWS_PER_MERGE = 1 << 13
#: What the schema of a log says that was recorded elsewhere: the columns that it does not have.
_UNRECORDED = b"not_recorded"


class NotRecordedError(KeyError):
    """A column that a run would have was not recorded.

    Attributes:
        column: its name.
    """

    def __init__(self, column: str) -> None:
        super().__init__(column)
        self.column = column


class RecordedColumns(dict[str, Vector]):
    """The columns of a log that was recorded elsewhere, of which any may be missing."""

    def __missing__(self, name: str) -> Vector:
        """Says which one is missing."""
        raise NotRecordedError(name)


def commanded(columns: Container[str]) -> str:
    """What the joints of a log's arm were commanded, by its columns: a word of `COMMANDS`."""
    named = (kind for kind in (VELOCITY, POSITION) if f"joint.1.{kind}.command" in columns)
    return next(named, TORQUE)


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


@dataclass(frozen=True)
class History:
    """Every tick of a run, one row each, in SI units.

    Attributes:
        columns: (n,) of every signal, by its name in the log; NaN where it has no value.
        stages: (n,) the stage of each row.
        units: of the columns, as the log states them.
        unrecorded: columns that a run would have, and that were not recorded where this log is
            from; empty for a run.
        rest: the ticks after the run in which its arm was brought to rest, which belong to no
            stage; None where there are none.
    """

    columns: Mapping[str, Vector]
    stages: NDArray[np.str_]
    units: Mapping[str, str] = field(default_factory=dict)
    unrecorded: frozenset[str] = frozenset()
    rest: History | None = None

    def __len__(self) -> int:
        return len(self.stages)

    @property
    def schema(self) -> pa.Schema:
        """Of a log that holds it."""
        names = [*self.columns]
        # Where the recorder has it.
        names.insert(names.index("t") + 1 if "t" in names else 0, STAGE)
        fields = [column_field(name, self.units.get(name, "")) for name in names]
        return log_schema(fields, self.unrecorded)

    def batches(self, rows: int) -> Iterator[pa.RecordBatch]:
        """The ticks in order as a log has them, up to some `rows` at a time."""
        parts = [self] if self.rest is None else [self, self.rest]
        names = np.unique([visit.stage for part in parts for visit in part.visits()])
        for part in parts:
            yield from part._batches(rows, names)

    def _batches(self, rows: int, names: NDArray[np.str_]) -> Iterator[pa.RecordBatch]:
        schema = self.schema
        for start in range(0, len(self), rows):
            part = slice(start, start + rows)
            codes = np.searchsorted(names, np.asarray(self.stages[part])).astype(np.int32)
            stages = pa.DictionaryArray.from_arrays(codes, names.tolist())
            arrays = [
                stages if name == STAGE else pa.array(self.columns[name][part])
                for name in schema.names
            ]
            yield pa.record_batch(arrays, schema=schema)

    def window(self, stage: str | None) -> Mask:
        """(n,) The rows of all visits of a stage, or every row for None."""
        window = empty(len(self), np.bool_)
        for part in blocks(len(self)):
            window[part] = stage is None
        for visit in self.visits() if stage is not None else ():
            if visit.stage == stage:
                window[visit.rows] = True
        return window

    def thinned(self, most: int) -> History:
        """Every tick of a short history; of a longer one every so many-th, some `most` in all.

        First and last tick of each visit are among them.
        """
        step = -(-len(self) // most)
        if step <= 1:
            return self
        ends = [row for visit in self.visits() for row in (visit.first, visit.last)]
        rows = np.unique(np.concatenate([np.arange(0, len(self), step), ends]))
        kept = empty((len(self.columns), len(rows)), np.float64)
        for row, values in zip(kept, self.columns.values(), strict=True):
            row[:] = values[rows]
        columns = dict(zip(self.columns, kept, strict=True))
        return replace(self, columns=columns, stages=self.stages[rows])

    def visits(self) -> Iterator[Visit]:
        """Each visit of a stage, in order; a stage that follows itself is visited anew."""
        return iter(self._visits)

    @cached_property
    def _visits(self) -> tuple[Visit, ...]:
        """All expectations use them: they are found once."""
        if not len(self):
            return ()
        t = self.columns["t"]
        new = np.flatnonzero((self.stages[1:] != self.stages[:-1]) | (t[1:] <= t[:-1])) + 1
        firsts = [0, *new.tolist()]
        lasts = [*(first - 1 for first in firsts[1:]), len(self) - 1]
        return tuple(
            Visit(str(self.stages[first]), first, last)
            for first, last in zip(firsts, lasts, strict=True)
        )


class HistoryBuilder:
    """Ticks as they come, batch by batch; those of a long run go to a file that is mapped."""

    def __init__(self) -> None:
        self._columns = GrowingColumns()
        #: Batches whose memory nobody writes anew, and the rows in them.
        self._batches: list[pa.RecordBatch] = []
        self._waiting = 0
        #: Names of stages, each with the number of ticks that follow each other in it.
        self._stages: list[tuple[str, int]] = []
        self._units: dict[str, str] = {}
        self._unrecorded: frozenset[str] = frozenset()

    def add(self, batch: pa.RecordBatch, *, lasting: bool = False) -> None:
        """Takes the ticks of a batch of a log.

        Args:
            batch: of them.
            lasting: whether its memory stays as it is; else it is copied.
        """
        if not self._units:
            self._units = units_of(batch.schema)
            self._unrecorded = unrecorded_of(batch.schema)
        self._stages += _stretches(batch.column(STAGE))
        if lasting:
            self._batches.append(batch)
            self._waiting += batch.num_rows
            if self._waiting >= _ROWS_PER_MERGE:
                self._put_together()
        else:
            self._columns.add({n: v.copy() for n, v in _numbers(batch)})

    def _put_together(self) -> None:
        """Makes columns of the batches that wait: of many at once it takes less time."""
        if self._batches:
            self._columns.add(dict(_numbers(pa.Table.from_batches(self._batches))))
            self._batches, self._waiting = [], 0

    def build(self) -> History:
        """All ticks so far; they are taken out."""
        self._put_together()
        stages, self._stages = self._stages, []
        names = _stage_names(stages)
        return split(_history(self._columns.build(), names, self._units, self._unrecorded))


def _numbers(ticks: pa.RecordBatch | pa.Table) -> Iterator[tuple[str, Vector]]:
    """Name and values of each column but that of the stages."""
    for name, values in zip(ticks.schema.names, ticks.columns, strict=True):
        if name != STAGE:
            # A table has columns of pieces, which it copies anyway.
            whole = {} if isinstance(ticks, pa.Table) else {"zero_copy_only": False}
            yield name, values.to_numpy(**whole)


def split(history: History) -> History:
    """A run without the ticks in which its arm was brought to rest, which stand beside it."""
    if not len(history) or history.stages[-1] != TO_REST:
        return history
    run = np.flatnonzero(history.stages != TO_REST)
    first = int(run[-1]) + 1 if len(run) else 0
    before, after = slice(0, first), slice(first, len(history))
    rest = _part(history, after)
    return replace(_part(history, before), rest=rest)


def _part(history: History, rows: slice) -> History:
    columns = {name: values[rows] for name, values in history.columns.items()}
    kept = RecordedColumns(columns) if history.unrecorded else columns
    return replace(history, columns=kept, stages=history.stages[rows])


def _stretches(values: pa.Array) -> Iterator[tuple[str, int]]:
    """Names of the stages of some ticks, each with how many ticks follow each other in it."""
    if not pa.types.is_dictionary(values.type):
        values = values.dictionary_encode()
    names = [str(name) for name in values.dictionary.to_pylist()]
    codes = values.indices.to_numpy()
    ends = [*(np.flatnonzero(codes[1:] != codes[:-1]) + 1).tolist(), len(codes)]
    first = 0
    for after in ends if len(codes) else ():
        yield names[codes[first]], after - first
        first = after


def _stage_names(stretches: Sequence[tuple[str, int]]) -> NDArray[np.str_]:
    """(n,) names of stages, not to be written; of a long run in a file that is mapped."""
    kind = np.array([*dict.fromkeys(name for name, _ in stretches)], dtype=np.str_).dtype
    stages, at = empty(sum(ticks for _, ticks in stretches), kind), 0
    for name, ticks in stretches:
        stages[at : at + ticks] = name
        at += ticks
    return stages


def history_of(batch: pa.RecordBatch) -> History:
    """The ticks of one batch of a log."""
    columns = {
        name: values.to_numpy(zero_copy_only=False)
        for name, values in zip(batch.schema.names, batch.columns, strict=True)
        if name != STAGE
    }
    schema = batch.schema
    return _history(columns, _texts(batch.column(STAGE)), units_of(schema), unrecorded_of(schema))


def _history(
    columns: dict[str, Vector],
    stages: NDArray[np.str_],
    units: Mapping[str, str],
    unrecorded: frozenset[str],
) -> History:
    return History(RecordedColumns(columns) if unrecorded else columns, stages, units, unrecorded)


def units_of(schema: pa.Schema) -> dict[str, str]:
    """The unit of each column, as a log states it; empty where it has none."""
    return {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in schema}


def unrecorded_of(schema: pa.Schema) -> frozenset[str]:
    """Columns that were not recorded, as a log says that was recorded elsewhere."""
    said = (schema.metadata or {}).get(_UNRECORDED, b"")
    try:
        names = json.loads(said) if said else []
    except ValueError:
        names = []
    return frozenset(map(str, names)) if isinstance(names, list) else frozenset()


def log_schema(fields: Sequence[pa.Field], unrecorded: frozenset[str]) -> pa.Schema:
    """The schema of a log; `unrecorded` are columns of a run that it does not have."""
    said = {_UNRECORDED: json.dumps(sorted(unrecorded))} if unrecorded else None
    return pa.schema(fields, metadata=said)


def column_field(name: str, unit: str) -> pa.Field:
    """What a log states of a column."""
    if name == STAGE:
        return pa.field(name, pa.dictionary(pa.int32(), pa.string()))
    return pa.field(name, pa.float64(), metadata={"unit": unit})


def _texts(values: pa.Array) -> NDArray[np.str_]:
    if not pa.types.is_dictionary(values.type):
        return np.array(values.to_pylist(), dtype=np.str_)
    names = np.array(values.dictionary.to_pylist(), dtype=np.str_)
    return np.asarray(names[values.indices.to_numpy()])
