"""A run as exports see it: its log in chunks of rows, and what its folder says of it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from taskspec_runner.record.extent import Extent, status_of
from taskspec_runner.record.folder import LOG, MANIFEST, SUMMARY
from taskspec_runner.record.history import History, stream_log, units_of

Json = Mapping[str, Any]

#: Rows that are in memory at a time: 8 MB at 100 columns.
ROWS = 10_000


@dataclass(frozen=True, slots=True)
class Source:
    """A run's folder.

    Attributes:
        folder: of the run. schema: of its log. manifest, summary: as read, empty where missing.
    """

    folder: Path
    schema: pa.Schema
    manifest: Json
    summary: Json

    @property
    def units(self) -> dict[str, str]:
        """The unit of each column, empty where it has none."""
        return units_of(self.schema.empty_table())

    def extent(self, ticks: int, until: float) -> Extent:
        """How much of the run there is in a log of so many ticks that ends at `until` [s]."""
        return Extent(status_of(self.manifest, self.summary), ticks, until)

    def chunks(self) -> Iterator[pa.RecordBatch]:
        """The log in order, up to some `ROWS` rows at a time."""
        held: list[pa.RecordBatch] = []
        for batch in stream_log(self.folder / LOG):
            held.append(batch)
            if sum(b.num_rows for b in held) >= ROWS:
                yield _joined(held)
                held = []
        if held:
            yield _joined(held)


def open_source(folder: Path) -> Source | None:
    """A run's folder; None where its log holds no tick.

    Raises:
        OSError: there is no log.
    """
    first = next(stream_log(folder / LOG), None)
    if first is None:
        return None
    return Source(folder, first.schema, _json(folder / MANIFEST), _json(folder / SUMMARY))


def columns_of(chunk: pa.RecordBatch) -> History:
    """A chunk as arrays."""
    columns = {
        name: chunk.column(name).to_numpy(zero_copy_only=False)
        for name in chunk.schema.names
        if name != "stage"
    }
    return History(columns, np.array(chunk.column("stage").to_pylist(), dtype=np.str_))


def _joined(batches: list[pa.RecordBatch]) -> pa.RecordBatch:
    return pa.Table.from_batches(batches).combine_chunks().to_batches()[0]


def _json(path: Path) -> Json:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, Mapping) else {}
