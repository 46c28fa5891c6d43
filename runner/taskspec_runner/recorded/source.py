"""A log that was recorded elsewhere, as a file has it: named columns of numbers and of words."""

from __future__ import annotations

import csv
import io
import os
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from taskspec.regular_file import open_regular
from taskspec_runner.errors import InputError
from taskspec_runner.export.tables import SCHEMA_SUM, schema_sum
from taskspec_runner.record.mapped import GrowingColumns
from taskspec_runner.recorded.sample_texts import SampleTexts, SampleTextsBuilder
from taskspec_runner.runs import ROWS

Vector = NDArray[np.float64]

_UNIT = re.compile(r"\A(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*\Z")
#: What parts the columns of a text, in the order of preference; the last is any white space.
_SEPARATORS = ("\t", ";", ",", " ")
#: The words of a column map for what stands before the decimals of a number.
POINT, COMMA = "point", "comma"
_WITH_COMMA = re.compile(r"\A[+-]?\d*,\d+(?:[eE][+-]?\d+)?\Z")
#: A number whose comma may part thousands.
_THOUSANDS = re.compile(r"\A[+-]?[1-9]\d{0,2},\d{3}\Z")
#: Lines from which separator and header are found, and bytes that these may have.
_FIRST_LINES, _LONGEST_HEADER = 200, 1 << 20
#: Bytes of a CSV file that are read at a time; no line is longer.
_BLOCK = 1 << 20
#: Bytes of a Parquet file's column that are read at a time, however long its parts are.
_BUFFER = 1 << 16


class LogSource(Protocol):
    """A log as a file has it.

    Attributes:
        path: of the file.
        form: of it, in a word.
        units: columns, and the unit that the file states of each; empty where it states none.
        lines: what a text says above its columns, by the word that each line begins with.
        columns: columns of a run's log that the file says it has, and what they are called in it.
        stated: metadata of the file.
        timed: whether each column has times of its own, as messages have; a message holds until
            the next one.
    """

    path: Path
    form: str
    units: Mapping[str, str]
    lines: Mapping[str, str]
    columns: Mapping[str, str]
    stated: Mapping[str, str]
    timed: bool

    def numbers(self, names: Sequence[str]) -> dict[str, Vector]:
        """(n,) values of some columns, which are read together; NaN where there is none.

        Raises:
            InputError: they are no numbers, or cannot be read.
        """

    def words(self, name: str) -> SampleTexts:
        """Values of a column as texts.

        Raises:
            InputError: they cannot be read, or are too many to be names of something.
        """

    def times(self, name: str, stamp: Sequence[str]) -> Vector | None:
        """(n,) when each value of a column was recorded, since the first of the log [s].

        None where a column of the log has the times of all others.

        Args:
            name: of the column.
            stamp: fields beside it that have the time, seconds and nanoseconds; none for the time
                at which it was logged.
        """

    def place(self, name: str, row: int) -> str:
        """Where a value of a column stands, in words."""


#: Columns of a table to its batches with these columns, in order.
Batches = Callable[[Sequence[str]], Iterator[pa.RecordBatch]]


class LogTable:
    """A CSV or Parquet file: one row a sample."""

    timed = False
    columns: Mapping[str, str] = MappingProxyType({})

    def __init__(
        self,
        path: Path,
        form: str,
        units: Mapping[str, str],
        batches: Batches,
        first: int,
        lines: Mapping[str, str],
        decimal: str = POINT,
        stated: Mapping[str, str] | None = None,
    ) -> None:
        """Takes a table.

        Args:
            path: of the file.
            form: of it, in a word.
            units: columns by their names, without units, and the units that it states.
            batches: reads some of the columns.
            first: number of the first row for a reader; 2 where a header stands before it.
            lines, stated: see `LogSource`.
            decimal: what stands before the decimals of numbers that are texts.
        """
        self._decimal, self.stated = decimal, stated or {}
        self.path, self.form, self.units, self.lines = path, form, units, lines
        self._batches, self._first = batches, first

    def numbers(self, names: Sequence[str]) -> dict[str, Vector]:
        """(n,) values of some columns, NaN where there is none."""
        found, row = GrowingColumns(), 0
        for batch in self._batches(names):
            found.add({name: self._numbers(name, batch.column(name), row) for name in names})
            row += batch.num_rows
        return found.build()

    def _numbers(self, name: str, column: pa.Array, first: int) -> Vector:
        """(n,) values of a part of a column; `first` is its first row."""
        if pa.types.is_string(column.type):
            return self._parsed(name, column, first)
        if pa.types.is_boolean(column.type):
            column = column.cast(pa.int8())
        try:
            return np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=float)
        except (pa.ArrowException, ValueError, TypeError) as error:
            raise InputError(f"{self.path}: column '{name}' is not of numbers") from error

    def _parsed(self, name: str, column: pa.Array, first: int) -> Vector:
        texts = pa.compute.utf8_trim_whitespace(column.fill_null(""))
        if self._decimal == COMMA:
            texts = pa.compute.replace_substring(texts, ",", ".")
        missing = pa.compute.is_in(texts, value_set=pa.array(["", "nan", "NaN", "NAN", "null"]))
        try:
            values = pa.compute.if_else(missing, None, texts).cast(pa.float64())
        except pa.ArrowException:
            for row, text in enumerate(texts.to_pylist()):
                if not missing[row].as_py() and not _is_number(text):
                    place = self.place(name, first + row)
                    raise InputError(
                        f"{self.path}: '{text}' is no number, in column '{name}', {place}"
                    ) from None
            raise InputError(f"{self.path}: column '{name}' is not of numbers") from None
        return np.asarray(values.to_numpy(zero_copy_only=False), dtype=float)

    def words(self, name: str) -> SampleTexts:
        """Values of a column as texts, empty where there is none."""
        found = SampleTextsBuilder()
        for batch in self._batches([name]):
            found.add(_texts(batch.column(name)))
        return found.words(f"{self.path}: column '{name}'")

    def times(self, name: str, stamp: Sequence[str]) -> None:
        """None: a table has a column for the time."""

    def place(self, name: str, row: int) -> str:  # noqa: ARG002
        """The line of a text, or the row of a table."""
        return f"{'line' if self.form == 'CSV' else 'row'} {row + self._first}"


def _texts(column: pa.Array) -> list[str]:
    if pa.types.is_floating(column.type):
        # A number of a stage is written as a whole one.
        return [f"{value:g}" for value in column.to_numpy(zero_copy_only=False).tolist()]
    texts: Sequence[str] = column.cast(pa.string()).fill_null("").to_pylist()
    return [text.strip() for text in texts]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_csv(path: Path, header: int | None = None, decimal: str | None = None) -> LogTable:
    """A text of lines; columns may be parted by a comma, a semicolon, a tab or white space.

    A last line without an end may have been cut short and is left out.

    Args:
        path: of the file.
        header: line with the names of the columns, from 1 on; None for the first line that has as
            many cells as most lines, and no number.
        decimal: what stands before the decimals of its numbers, `POINT` or `COMMA`; None to find
            it.

    Raises:
        InputError: it is no such text, has no header, or no row, or a comma in its numbers may part
            decimals or thousands.
    """
    try:
        with open_regular(path) as file:
            head = file.read(_LONGEST_HEADER)
            end = _end_of_lines(file)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    if b"\0" in head:
        raise InputError(f"cannot read {path}: it is no text, nor Parquet nor MCAP")
    whole = head[:end].split(b"\n")[: max(_FIRST_LINES, header or 0)]
    try:
        lines = [line.decode("utf-8-sig").rstrip("\r") for line in whole]
    except UnicodeDecodeError as error:
        raise InputError(f"cannot read {path}: it is not UTF-8") from error
    if not any(line.strip() for line in lines):
        text = head.decode("utf-8-sig", "replace").strip()
        said = "it has a header and no sample" if text else "it is empty"
        raise InputError(f"cannot read {path}: {said}")
    at, separator = _header(lines, header)
    if at >= len(lines):
        raise InputError(f"cannot read {path}: it has no line {at + 1}")
    names = _cells(lines[at], separator)
    start = sum(len(line) + 1 for line in whole[: at + 1])
    if not head[start:].strip():
        raise InputError(f"cannot read {path}: it has a header and no sample")
    if end <= start:
        raise InputError(f"cannot read {path}: it holds no whole sample")
    try:
        decimal = decimal or _decimal(lines[at + 1 :], separator)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    rows = _CsvRows(path, separator, len(names), start, end)
    above = (_cells(line, separator) for line in lines[:at])
    stated = {cells[0].rstrip(" :"): cells[1] for cells in above if len(cells) > 1}
    return _table(path, "CSV", names, [""] * len(names), rows.batches, at + 2, stated, decimal)


def _header(lines: Sequence[str], stated: int | None) -> tuple[int, str]:
    """Row of the line that names the columns, from 0 on, and what parts them."""
    found: list[tuple[int, int, str]] = []
    for separator in _SEPARATORS:
        counts = [len(_cells(line, separator)) for line in lines]
        usual = Counter(count for count in counts if count > 1).most_common(1)
        if not usual:
            continue
        if stated is not None:
            found.append((counts[min(stated, len(lines)) - 1], stated - 1, separator))
            continue
        row = counts.index(usual[0][0])
        if not any(map(_is_number, _cells(lines[row], separator))):
            found.append((usual[0][0], row, separator))
    best = max((each for each in found if each[2] != " "), key=lambda each: each[0], default=None)
    best = best or next(iter(found), None)
    if best is not None:
        return best[1], best[2]
    first = next(row for row, line in enumerate(lines) if line.strip())
    at = first if stated is None else stated - 1
    text = lines[min(at, len(lines) - 1)]
    return at, max(_SEPARATORS[:3], key=text.count)


def _decimal(lines: Sequence[str], separator: str) -> str:
    """What stands before the decimals of the numbers of some lines.

    Raises:
        ValueError: a comma may part decimals or thousands.
    """
    cells = [cell for line in lines for cell in _cells(line, separator)]
    commas = [cell for cell in cells if _WITH_COMMA.match(cell)]
    if not commas or any("." in cell and _is_number(cell) for cell in cells):
        return POINT
    if all(map(_THOUSANDS.match, commas)):
        whole = commas[0].replace(",", "")
        raise ValueError(
            f"'{commas[0]}' may be {commas[0].replace(',', '.')} or {whole}; say which in the "
            "column map: decimal: comma, or decimal: point"
        )
    return COMMA


def _cells(line: str, separator: str) -> list[str]:
    """The cells of a line without quotes and spaces around them; of an empty line none."""
    text = line.strip().removeprefix("# ") if separator == " " else line.removeprefix("# ")
    row = next(csv.reader([text], delimiter=separator, skipinitialspace=True), [])
    cells = [cell.strip() for cell in row]
    return [cell for cell in cells if cell] if separator == " " else cells


def _end_of_lines(file: BinaryIO) -> int:
    """Where the last whole line of a file ends [bytes]."""
    at = file.seek(0, os.SEEK_END)
    while at:
        start = max(at - _LONGEST_HEADER, 0)
        file.seek(start)
        found = file.read(at - start).rfind(b"\n")
        if found >= 0:
            return start + found + 1
        at = start
    return 0


class _Part(io.RawIOBase):
    """A part of a file as a file of its own."""

    def __init__(self, file: BinaryIO, start: int, end: int) -> None:
        self._file, self._left = file, end - start
        file.seek(start)

    def readable(self) -> bool:
        """True: a CSV file can always be read."""
        return True

    def readinto(self, into: Any) -> int:
        """Fills a buffer as far as there is something; returns how many bytes."""
        content = self._file.read(min(len(into), self._left))
        self._left -= len(content)
        into[: len(content)] = content
        return len(content)


class _Spaced(_Part):
    """The same of a text whose cells are parted by any white space: by one space each."""

    def readinto(self, into: Any) -> int:
        """Fills a buffer with whole lines as far as there are some; returns how many bytes."""
        content = self._file.read(min(len(into), self._left))
        last = content.rfind(b"\n") + 1 or len(content)
        # The rest of a line is read again with what follows it.
        self._file.seek(last - len(content), os.SEEK_CUR)
        self._left -= last
        lines = content[:last].split(b"\n")
        plain = b"\n".join(b" ".join(line.split()) for line in lines)
        into[: len(plain)] = plain
        return len(plain)


class _CsvRows:
    """The rows of a CSV file, read anew at each use."""

    def __init__(self, path: Path, separator: str, columns: int, start: int, end: int) -> None:
        self._path, self._separator = path, separator
        self._numbers = [str(number) for number in range(columns)]
        self._start, self._end = start, end

    def batches(self, columns: Sequence[int]) -> Iterator[pa.RecordBatch]:
        """Batches of some columns, by their numbers, all of them texts."""
        converting = pa.csv.ConvertOptions(
            column_types=dict.fromkeys(self._numbers, pa.string()),
            include_columns=[self._numbers[number] for number in columns],
            strings_can_be_null=False,
        )
        reading = pa.csv.ReadOptions(
            column_names=self._numbers, use_threads=False, encoding="utf8", block_size=_BLOCK
        )
        parsing = pa.csv.ParseOptions(delimiter=self._separator)
        try:
            with open_regular(self._path) as file:
                kind = _Spaced if self._separator == " " else _Part
                part = pa.PythonFile(kind(file, self._start, self._end), mode="r")
                yield from pa.csv.open_csv(part, reading, parsing, converting)
        except pa.ArrowException as error:
            said = " ".join(str(error).split())
            raise InputError(
                f"cannot read {self._path}: its lines do not all have as many columns as its "
                f"header ({said})"
            ) from error
        except OSError as error:
            raise InputError(f"cannot read {self._path}: {error.strerror or error}") from error


def read_parquet(path: Path) -> LogTable:
    """A Parquet file; units stand in the metadata of its columns.

    Raises:
        InputError: it is no such file.
    """
    with _parquet(path) as file:
        schema, rows = file.schema_arrow, file.metadata.num_rows
        metadata = file.metadata.metadata or {}
    stated = {key.decode("utf-8", "replace"): value.decode("utf-8", "replace")
              for key, value in metadata.items()}  # fmt: skip
    if SCHEMA_SUM in stated and stated[SCHEMA_SUM] != schema_sum(schema):
        raise InputError(
            f"cannot read {path}: it is no whole Parquet file (the checksum of its schema is "
            "another one)"
        )
    units = [(f.metadata or {}).get(b"unit", b"").decode("utf-8", "replace") for f in schema]
    names = [field.name for field in schema]

    def batches(columns: Sequence[int]) -> Iterator[pa.RecordBatch]:
        with _parquet(path) as file:
            wanted, left = [names[number] for number in columns], rows
            for batch in file.iter_batches(ROWS, columns=wanted, use_threads=False):
                # A name with dots may bring others, of which it is the beginning.
                found = [batch.column(batch.schema.get_field_index(name)) for name in wanted]
                left -= batch.num_rows
                yield pa.RecordBatch.from_arrays(found, wanted)
        if left:
            raise InputError(
                f"cannot read {path}: it is no whole Parquet file (it holds {rows - left} of "
                f"{rows} samples)"
            )

    if not rows:
        raise InputError(f"cannot read {path}: it holds no sample")
    return _table(path, "Parquet", names, units, batches, 1, {}, stated=stated)


@contextmanager
def _parquet(path: Path) -> Iterator[pq.ParquetFile]:
    try:
        # Read ahead, the whole file would be in memory.
        with pq.ParquetFile(
            path, buffer_size=_BUFFER, pre_buffer=False, page_checksum_verification=True
        ) as file:
            yield file
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        said = " ".join(str(error).split())
        raise InputError(f"cannot read {path}: it is no whole Parquet file ({said})") from error


def _table(
    path: Path,
    form: str,
    names: Sequence[str],
    units: Sequence[str],
    batches: Callable[[Sequence[int]], Iterator[pa.RecordBatch]],
    first: int,
    lines: Mapping[str, str],
    decimal: str = POINT,
    stated: Mapping[str, str] | None = None,
) -> LogTable:
    """A table whose columns are called without the units that stand behind their names.

    Args:
        path, form, first, lines, decimal, stated: see `LogTable`.
        names: of the columns, with or without units.
        units: that stand elsewhere.
        batches: reads some columns, by their numbers.
    """
    split = [named(name) for name in names]
    bare = [name for name, _ in split]
    twice = {name for name, count in Counter(bare).items() if count > 1}
    stating = [unit or own for unit, (_, own) in zip(units, split, strict=True)]

    def read(wanted: Sequence[str]) -> Iterator[pa.RecordBatch]:
        several = next((name for name in wanted if name in twice), None)
        if several is not None:
            raise InputError(f"cannot read {path}: it has more than one column '{several}'")
        for batch in batches([bare.index(name) for name in wanted]):
            yield batch.rename_columns(list(wanted))

    named_units = dict(zip(bare, stating, strict=True))
    return LogTable(path, form, named_units, read, first, lines, decimal, stated)


def named(text: str) -> tuple[str, str]:
    """The name and the unit of a header such as `force.z [N]`; the unit is empty without one.

    A number in brackets is an index: `q[0]` has no unit.
    """
    match = _UNIT.match(text)
    if not match or not match[1] or match[2].strip().isdigit():
        return text.strip(), ""
    return match[1], match[2].strip()


def open_source(path: Path, header: int | None = None, decimal: str | None = None) -> LogSource:
    """A log, by what it begins with: Parquet, MCAP, else CSV.

    Args:
        path: of the file.
        header: line of a CSV file that names the columns; None to find it.
        decimal: what stands before the decimals of its numbers; None to find it.

    Raises:
        InputError: it is none of them, or is empty or cut short.
    """
    from taskspec_runner.export.chunks import MAGIC
    from taskspec_runner.recorded.messages import read_mcap

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
    return read_csv(path, header, decimal)
