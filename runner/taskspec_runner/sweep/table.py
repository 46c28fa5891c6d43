"""The table of a sweep: a row a world, in the order of the worlds, without any times."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from taskspec.program.context import Context
from taskspec.program.worlds import World, world_from
from taskspec.regular_file import open_regular
from taskspec_runner.errors import InputError
from taskspec_runner.record.folder import parse_json
from taskspec_runner.record.names import TABLE
from taskspec_runner.sweep.world_run import Row

_WHOLE = ("world", "seed", "number", "ticks")
_TEXTS = ("label", "draws", "verdict", "status", "reason", "stage", "text", "findings")
#: Columns that every table has, whatever became of its worlds.
_ALWAYS = ("world", "label", "seed", "number", "draws", "success", "verdict", "status", "reason",
           "text")  # fmt: skip


def table_bytes(rows: Mapping[int, Row], said: Mapping[str, str]) -> bytes:
    """The table as Parquet: the same bytes for the same rows, in whatever order they came.

    Args:
        rows: by the number of their world.
        said: what the file is to say of itself.
    """
    file = io.BytesIO()
    metadata = {key: value.encode() for key, value in sorted(said.items())}
    table = as_table([rows[number] for number in sorted(rows)]).replace_schema_metadata(metadata)
    pq.write_table(table, file, compression="zstd", version="2.6", write_page_checksum=True)
    return file.getvalue()


def as_table(rows: Sequence[Row]) -> pa.Table:
    """Rows as a table; a world that broke has nothing in most columns."""
    # A row that has all of them gives their order.
    names = dict.fromkeys(_ALWAYS)
    for row in sorted(rows, key=lambda each: -len(each)):
        names |= dict.fromkeys(row)
    fields = [(name, _type(name)) for name in names]
    arrays = [pa.array([row.get(name) for row in rows], kind) for name, kind in fields]
    return pa.table(arrays, schema=pa.schema(fields))


def _type(name: str) -> pa.DataType:
    if name in _WHOLE:
        return pa.uint64() if name == "seed" else pa.int64()
    if name in _TEXTS:
        return pa.string()
    return pa.bool_() if name == "success" or name.startswith("expect ") else pa.float64()


def read_table(path: Path) -> pa.Table:
    """The table of a file.

    Raises:
        InputError: it is none of a sweep.
    """
    try:
        with open_regular(path) as file:
            table = pq.read_table(file, page_checksum_verification=True)
    except (OSError, pa.ArrowException) as error:
        raise InputError(
            f"cannot read {path}: {getattr(error, 'strerror', None) or error}"
        ) from error
    if any(name not in table.column_names for name in _ALWAYS):
        raise InputError(f"{path} is no table of a sweep")
    return table


def world_in(path: Path, row: int, context: Context) -> World:
    """The world of a row of a table, or of that in the folder of a sweep, counted from 0.

    Raises:
        InputError: there is no such row, or it is of another task.
    """
    path = path / TABLE if path.is_dir() else path
    table = read_table(path)
    numbers = table["world"].to_pylist()
    if row not in numbers:
        raise InputError(f"{path} has no world {row}; it has {_span(numbers)}")
    found: dict[str, Any] = table.slice(numbers.index(row), 1).to_pylist()[0]
    data = {"label": found["label"], "number": found["number"]}
    try:
        draws = parse_json(found["draws"].encode())
        return world_from(context, {**data, "draws": draws}, int(found["seed"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path} is of another task, or was altered: {error!r}") from error


def _span(numbers: Sequence[int]) -> str:
    return f"{min(numbers)} to {max(numbers)}" if numbers else "no row"
