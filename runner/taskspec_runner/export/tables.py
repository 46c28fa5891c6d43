"""CSV and Parquet: one row a tick, columns as in the log."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from taskspec_runner.export.source import Source


def write_csv(source: Source, chunks: Iterable[pa.RecordBatch], path: Path) -> None:
    """Writes a table as text: units in its header, as in `force.z [N]`; no value is no text."""
    units = source.units
    header = [f"{name} [{units[name]}]" if units[name] else name for name in source.schema.names]
    fields = [
        (name, pa.string() if name == "stage" else pa.float64()) for name in source.schema.names
    ]
    schema = pa.schema(fields)
    options = pa.csv.WriteOptions(include_header=False, quoting_style="none")
    with path.open("wb") as file:
        # The library puts every name of a header into quotes, which not every reader takes off.
        file.write((",".join(header) + "\n").encode())
        with pa.csv.CSVWriter(file, schema, write_options=options) as writer:
            for chunk in chunks:
                arrays = [_text(chunk.column(name)) for name in schema.names]
                writer.write_batch(pa.record_batch(arrays, schema=schema))


def write_parquet(source: Source, chunks: Iterable[pa.RecordBatch], path: Path) -> None:
    """Writes a table with the log's types and units, and what is known of the run as metadata."""
    with pq.ParquetWriter(path, source.schema) as writer:
        ticks = 0
        for chunk in chunks:
            writer.write_batch(chunk)
            ticks += chunk.num_rows
        writer.add_key_value_metadata(run_metadata(source, ticks))


def run_metadata(source: Source, ticks: int) -> dict[str, str]:
    """What a reader of the log alone must know of the run, as texts."""
    manifest = source.manifest
    extent = source.extent(ticks, 0.0)
    return {
        "taskspec.task": str(manifest.get("task") or ""),
        "taskspec.status": extent.status,
        "taskspec.partial": json.dumps(extent.partial),
        "taskspec.ticks": str(ticks),
        "taskspec.seed": str(manifest.get("seed", "")),
        "taskspec.versions": json.dumps(manifest.get("versions") or {}),
    }


def _text(column: pa.Array) -> pa.Array:
    if pa.types.is_dictionary(column.type):
        return column.cast(pa.string())
    return pc.if_else(pc.is_nan(column), None, column)
