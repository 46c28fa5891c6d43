"""CSV and Parquet: one row a tick, columns as in the log."""

from __future__ import annotations

import zlib
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from taskspec_runner.export.stream import LogStream
from taskspec_runner.record.history import STAGE

#: Key of the checksum in a Parquet file's metadata.
SCHEMA_SUM = "taskspec.schema"


def write_csv(log: LogStream, path: Path) -> None:
    """Writes a table as text: units in its header, as in `force.z [N]`; no value is no text.

    Its last line is no tick: it has the time at which the run ended, and as its stage `end` or
    `fail`.
    """
    header = [f"{name} [{unit}]" if unit else name for name, unit in log.units.items()]
    fields = [(name, pa.string() if name == STAGE else pa.float64()) for name in log.units]
    schema = pa.schema(fields)
    options = pa.csv.WriteOptions(include_header=False, quoting_style="none")
    with path.open("wb") as file:
        # The library puts every name of a header into quotes, which not every reader takes off.
        file.write((",".join(header) + "\n").encode())
        with pa.csv.CSVWriter(file, schema, write_options=options) as writer:
            for batch in log:
                arrays = [_text(batch.column(name)) for name in schema.names]
                writer.write_batch(pa.record_batch(arrays, schema=schema))
        if log.ended:
            # No tick: when and where the run led, which the last tick does not say.
            said = {"clock": f"{log.extent.until:.12g}", STAGE: log.ended}
            file.write((",".join(said.get(name, "") for name in log.units) + "\n").encode())


def write_parquet(log: LogStream, path: Path) -> None:
    """Writes a table with the log's types and units, and what is known of the run as metadata.

    Its pages have checksums; of the schema, which the format has none for, there is one in the
    metadata.
    """
    with pq.ParquetWriter(path, log.schema, write_page_checksum=True) as writer:
        for batch in log:
            writer.write_batch(batch)
        writer.add_key_value_metadata(log.metadata | {SCHEMA_SUM: schema_sum(log.schema)})


def schema_sum(schema: pa.Schema) -> str:
    """A checksum of the columns' names, types and units, in their order."""
    fields = [(f.name, str(f.type), (f.metadata or {}).get(b"unit")) for f in schema]
    return f"{zlib.crc32(repr(fields).encode()):08x}"


def _text(column: pa.Array) -> pa.Array:
    if pa.types.is_dictionary(column.type):
        return column.cast(pa.string())
    return pc.if_else(pc.is_nan(column), None, column)
