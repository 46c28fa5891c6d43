"""A log that was recorded elsewhere, as a file has it: named columns of numbers and of words."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from taskspec_runner.errors import InputError
from taskspec_runner.record.whole import open_regular

Vector = NDArray[np.float64]

_UNIT = re.compile(r"\A(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*\Z")
_SEPARATORS = ",;\t"
#: A header that is longer is none.
_LONGEST_HEADER = 1 << 20


class LogSource(Protocol):
    """A log as a file has it.

    Attributes:
        path: of the file.
        form: of it, in a word.
        units: columns, and the unit that the file states of each; empty where it states none.
        timed: whether each column has times of its own, as messages have; a message holds until
            the next one.
    """

    path: Path
    form: str
    units: Mapping[str, str]
    timed: bool

    def numbers(self, name: str) -> Vector:
        """(n,) values of a column, NaN where there is none.

        Raises:
            InputError: they are no numbers.
        """

    def words(self, name: str) -> Sequence[str]:
        """Values of a column as texts.

        Raises:
            InputError: they cannot be read.
        """

    def times(self, name: str) -> Vector | None:
        """(n,) when each value of a column was recorded, since the first of the log [s].

        None where a column of the log has the times of all others.
        """

    def place(self, name: str, row: int) -> str:
        """Where a value of a column stands, in words."""


class LogTable:
    """A CSV or Parquet file: one row a sample."""

    timed = False

    def __init__(
        self, path: Path, form: str, table: pa.Table, units: Mapping[str, str], first: int
    ) -> None:
        """Takes a table.

        Args:
            path: of the file.
            form: of it, in a word.
            table: its columns by their names, without units.
            units: that it states.
            first: number of the first row for a reader; 2 where a header stands before it.
        """
        self.path, self.form, self.units = path, form, units
        self._table, self._first = table, first

    def numbers(self, name: str) -> Vector:
        """(n,) values of a column, NaN where there is none."""
        column = self._table[name]
        if pa.types.is_string(column.type):
            return self._parsed(name, column)
        if pa.types.is_boolean(column.type):
            column = column.cast(pa.int8())
        try:
            return np.asarray(column.cast(pa.float64()).to_numpy(), dtype=float)
        except (pa.ArrowException, ValueError, TypeError) as error:
            raise InputError(f"{self.path}: column '{name}' is not of numbers") from error

    def _parsed(self, name: str, column: pa.ChunkedArray) -> Vector:
        texts = pa.compute.utf8_trim_whitespace(column.fill_null(""))
        missing = pa.compute.is_in(texts, value_set=pa.array(["", "nan", "NaN", "NAN", "null"]))
        try:
            values = pa.compute.if_else(missing, None, texts).cast(pa.float64())
        except pa.ArrowException:
            for row, text in enumerate(texts.to_pylist()):
                if not missing[row].as_py() and not _is_number(text):
                    place = self.place(name, row)
                    raise InputError(
                        f"{self.path}: '{text}' is no number, in column '{name}', {place}"
                    ) from None
            raise InputError(f"{self.path}: column '{name}' is not of numbers") from None
        return np.asarray(values.to_numpy(), dtype=float)

    def words(self, name: str) -> Sequence[str]:
        """Values of a column as texts, empty where there is none."""
        column = self._table[name]
        if pa.types.is_floating(column.type):
            # A number of a stage is written as a whole one.
            return [f"{value:g}" for value in column.to_numpy().tolist()]
        texts: Sequence[str] = column.cast(pa.string()).fill_null("").to_pylist()
        return [text.strip() for text in texts]

    def times(self, name: str) -> None:
        """None: a table has a column for the time."""

    def place(self, name: str, row: int) -> str:  # noqa: ARG002
        """The line of a text, or the row of a table."""
        return f"{'line' if self.form == 'CSV' else 'row'} {row + self._first}"


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_csv(path: Path) -> LogTable:
    """A CSV file with a header; columns may be parted by a comma, a semicolon or a tab.

    A last line without an end may have been cut short and is left out.

    Raises:
        InputError: it is no such file.
    """
    try:
        with open_regular(path) as file:
            content = file.read()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    if b"\0" in content[:_LONGEST_HEADER]:
        raise InputError(f"cannot read {path}: it is no text, nor Parquet nor MCAP")
    header, newline, rest = content[:_LONGEST_HEADER].partition(b"\n")
    try:
        text = header.decode("utf-8-sig").rstrip("\r")
    except UnicodeDecodeError as error:
        raise InputError(f"cannot read {path}: it is not UTF-8") from error
    if not text.strip():
        raise InputError(f"cannot read {path}: it is empty")
    if not newline or not rest.strip():
        raise InputError(f"cannot read {path}: it has a header and no sample")
    separator = max(_SEPARATORS, key=text.count)
    names = [each.strip().strip('"') for each in text.split(separator)]
    content = content[: content.rindex(b"\n") + 1]
    options = pa.csv.ConvertOptions(
        column_types=dict.fromkeys(_numbered(names), pa.string()), strings_can_be_null=False
    )
    reading = pa.csv.ReadOptions(
        column_names=_numbered(names), skip_rows=1, use_threads=False, encoding="utf8"
    )
    parsing = pa.csv.ParseOptions(delimiter=separator)
    try:
        table = pa.csv.read_csv(pa.py_buffer(content), reading, parsing, options)
    except pa.ArrowException as error:
        said = " ".join(str(error).split())
        raise InputError(
            f"cannot read {path}: its lines do not all have as many columns as its header ({said})"
        ) from error
    return _table(path, "CSV", table, names, [""] * len(names), 2)


def _numbered(names: Sequence[str]) -> list[str]:
    return [str(number) for number in range(len(names))]


def read_parquet(path: Path) -> LogTable:
    """A Parquet file; units stand in the metadata of its columns.

    Raises:
        InputError: it is no such file.
    """
    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        said = " ".join(str(error).split())
        raise InputError(f"cannot read {path}: it is no whole Parquet file ({said})") from error
    units = [(f.metadata or {}).get(b"unit", b"").decode("utf-8", "replace") for f in table.schema]
    names = [field.name for field in table.schema]
    return _table(path, "Parquet", table, names, units, 1)


def _table(
    path: Path,
    form: str,
    table: pa.Table,
    names: Sequence[str],
    units: Sequence[str],
    first: int,
) -> LogTable:
    """A table whose columns are called without the units that stand behind their names."""
    if not table.num_rows:
        raise InputError(f"cannot read {path}: it holds no sample")
    split = [named(name) for name in names]
    bare = [name for name, _ in split]
    twice = sorted({name for name in bare if bare.count(name) > 1})
    if twice:
        raise InputError(f"cannot read {path}: it has more than one column '{twice[0]}'")
    stated = [unit or own for unit, (_, own) in zip(units, split, strict=True)]
    renamed = table.rename_columns(bare)
    return LogTable(path, form, renamed, dict(zip(bare, stated, strict=True)), first)


def named(text: str) -> tuple[str, str]:
    """The name and the unit of a header such as `force.z [N]`; the unit is empty without one."""
    match = _UNIT.match(text)
    return (match[1], match[2].strip()) if match and match[1] else (text.strip(), "")


def open_source(path: Path) -> LogSource:
    """A log, by what it begins with: Parquet, MCAP, else CSV.

    Raises:
        InputError: it is none of them, or is empty or cut short.
    """
    from taskspec_runner.recorded.messages import MAGIC, read_mcap

    try:
        with open_regular(path) as file:
            head = file.read(len(MAGIC))
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    if not head:
        raise InputError(f"cannot read {path}: it is empty")
    if head == MAGIC or path.suffix == ".mcap":
        return read_mcap(path)
    if head.startswith(b"PAR1") or path.suffix == ".parquet":
        return read_parquet(path)
    return read_csv(path)
