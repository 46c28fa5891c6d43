"""The log of a run on the disk: an Arrow IPC stream, in batches that survive a killed run."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
from collections.abc import Iterator, Mapping
from io import BufferedReader
from pathlib import Path

from taskspec.deferred import pa
from taskspec.regular_file import open_regular
from taskspec_runner.errors import OutputError
from taskspec_runner.record.block import Block
from taskspec_runner.record.history import STAGE, History, HistoryBuilder
from taskspec_runner.record.names import BLOCK

#: What a batch says: its number from 0, ticks before it, its run, SHA-256 of what is before it.
_NUMBER, _FIRST, _RUN, _BEFORE = b"batch", b"first", b"run", b"before"
#: Columns that every log has.
_NEEDED = ("clock", "t", STAGE)


class Log:
    """The log of a run that goes on: every batch on the disk at once, and its columns in memory.

    Args:
        path: of the file, which is not there yet.
        keep: whether columns are kept in memory.
        run: what the batches say of their run, so that they are not taken for another's.
    """

    def __init__(self, path: Path, *, keep: bool = True, run: str = "") -> None:
        self._path, self._written = path, 0
        self._file = path.open("xb", buffering=0)
        self._sha256 = hashlib.sha256()
        # A batch is many small pieces: they are put together, hashed and written as one.
        self._pieces = io.BytesIO()
        self._failure: OutputError | None = None
        self._writer: pa.ipc.RecordBatchStreamWriter | None = None
        self._columns, self._keep = HistoryBuilder(), keep
        self._run, self._batches, self._ticks, self._sums = run, 0, 0, self.sha256

    def block(self, room: int, fields: int) -> Block:
        """What takes the ticks of the next batch, in a file beside the log.

        Raises:
            OutputError: it cannot be made.
        """
        return Block.file(self._path.with_name(BLOCK), room, fields)

    def write(self, batch: pa.RecordBatch) -> None:
        """Appends some ticks, whole or not at all.

        Raises:
            OutputError: they cannot be written; the file ends with the batch before.
        """
        if self._failure is not None:
            # The stream goes on from what was not written.
            raise self._failure
        if self._writer is None:
            self._writer = pa.ipc.new_stream(self._pieces, batch.schema)
        said = {_NUMBER: self._batches, _FIRST: self._ticks, _RUN: self._run}
        marks = {key: str(value).encode() for key, value in said.items()}
        marks[_BEFORE] = self.sha256.encode()
        self._writer.write_batch(batch, pa.KeyValueMetadata(marks))
        self._append()
        self._batches, self._ticks = self._batches + 1, self._ticks + batch.num_rows
        self._sums = self.sha256
        if self._keep:
            self._columns.add(batch, lasting=True)

    def close(self) -> None:
        """Ends the stream and brings it to the disk.

        Raises:
            OutputError: it cannot be written.
        """
        try:
            if self._writer is not None and self._failure is None:
                self._writer.close()
                self._append()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise OutputError.of(self._path, error) from error
        finally:
            self._file.close()

    def _append(self) -> None:
        """Brings to the disk what the writer has put together."""
        try:
            with self._pieces.getbuffer() as pieces:
                self._write(pieces)
                self._sha256.update(pieces)
                self._written += len(pieces)
        except OSError as error:
            # What is there of a batch that is not complete would only be an obstacle.
            with contextlib.suppress(OSError):
                self._file.truncate(self._written)
            self._failure = OutputError.of(self._path, error)
            raise self._failure from error
        finally:
            self._pieces.seek(0)
            self._pieces.truncate()

    def _write(self, pieces: memoryview) -> None:
        # A disk that becomes full takes a part.
        done = 0
        while done < len(pieces):
            with pieces[done:] as rest:
                done += self._file.write(rest)

    @property
    def sha256(self) -> str:
        """Of the file, as far as it is written."""
        return self._sha256.hexdigest()

    @property
    def facts(self) -> dict[str, int | str]:
        """What a manifest keeps of it, apart from the SHA-256 of the whole."""
        return {"bytes": self._written, "ticks": self._ticks, "sha256_of_batches": self._sums}

    def history(self) -> History:
        """Every tick that was written; it leaves none here, so that they are in memory once."""
        return self._columns.build()


class LogReader:
    """A log on the disk, batch by batch, as far as it is what a run wrote.

    Every batch says what the file before it came to, so each is known to be good by the next one,
    and the last by what the run has noted elsewhere. A batch that is not as it was written is left
    out, and so is what comes after it.

    Attributes:
        batches, ticks: that were read so far.
        damage: why reading ended before the end of the stream; empty if it did not, or not yet.
        cut: whether it ended where the file does, as that of a killed run may.
    """

    def __init__(self, path: Path, *, run: str | None = None, last: str | None = None) -> None:
        """Opens a log.

        Args:
            path: of the file.
            run: what its batches say of their run, if they do; None for any.
            last: SHA-256 of the file up to the end of the last batch that counts; empty for a log
                that is known to be whole; None where it is not known, and the last is used.

        Raises:
            OSError: there is none, or it is no regular file.
        """
        self._file, self._name = _HashedFile(open_regular(path), used=last != ""), path.name
        self._expected, self._last = run, last
        self.batches = self.ticks = 0
        self.damage, self.cut = "", False

    def __iter__(self) -> Iterator[pa.RecordBatch]:
        held: pa.RecordBatch | None = None
        try:
            reader, before, batch = None, self._file.digest(), None
            while True:
                if reader is None:
                    reader = pa.ipc.open_stream(self._file)
                    self._check_schema(reader.schema)
                batch, marks = reader.read_next_batch_with_custom_metadata()
                said = dict(marks.items()) if marks is not None else {}
                self._check_before(said, before)
                if held is not None:
                    known, held = held, None
                    yield self._counted(known)
                if self._last and before == self._last:
                    # What comes after it was not noted any more.
                    return
                self._check(batch, said)
                held, before = batch, self._file.digest()
        except StopIteration:
            if self._file.read(1):
                self.damage = f"{self._name} was altered: something follows after its end"
        except _AlteredError as error:
            self.damage = f"{self._name} was altered: {error}"
            return
        # Arrow has errors of its own, and those of Python, for what it cannot read.
        except (pa.ArrowException, OSError, ValueError, LookupError, TypeError, MemoryError):
            self.cut = not self._file.read(1)
            place = _place(self.batches + (held is not None), self.ticks + _rows(held))
            how = "ends within" if self.cut else "was altered: it cannot be read from"
            self.damage = f"{self._name} {how} {place}"
        finally:
            self._file.close()
        if held is None:
            return
        if not self._last or before == self._last:
            yield self._counted(held)
        elif not self.damage:
            what = f"{_place(self.batches, self.ticks)} is not the last one that the run wrote"
            self.damage = f"{self._name} was altered: {what}"

    def _check_before(self, said: Mapping[bytes, bytes], before: str) -> None:
        """Holds the batch before one against what that one says of it."""
        if self._last != "" and said.get(_BEFORE) != before.encode():
            raise _AlteredError(self._not_so())

    def _counted(self, batch: pa.RecordBatch) -> pa.RecordBatch:
        self.batches, self.ticks = self.batches + 1, self.ticks + batch.num_rows
        return batch

    def _not_so(self) -> str:
        return f"{_place(self.batches, self.ticks)} is not as the run wrote it"

    def _check_schema(self, schema: pa.Schema) -> None:
        names = schema.names
        kinds = {field.name: field.type for field in schema}
        stage = kinds.pop(STAGE, None)
        if len(set(names)) != len(names) or not set(_NEEDED) <= set(names):
            raise _AlteredError("its columns are not those of a run")
        if stage != pa.dictionary(pa.int32(), pa.string()) or {*kinds.values()} != {pa.float64()}:
            raise _AlteredError("its columns are not of the types that a run writes")
        for field in schema:
            (field.metadata or {}).get(b"unit", b"").decode()

    def _check(self, batch: pa.RecordBatch, said: Mapping[bytes, bytes]) -> None:
        batch.validate(full=True)
        if any(column.null_count for column in batch.columns):
            raise _AlteredError(self._not_so())
        wanted = (str(self.batches).encode(), str(self.ticks).encode())
        if said and (said.get(_NUMBER), said.get(_FIRST)) != wanted:
            number = said.get(_NUMBER, b"").decode("ascii", "replace")
            where = _place(self.batches, self.ticks)
            raise _AlteredError(f"batch {number} stands where {where} was")
        if self._expected is not None and said.get(_RUN) not in (self._expected.encode(), b""):
            raise _AlteredError("it is the log of another run")


class _AlteredError(Exception):
    """A log is not what a run wrote; the message says where."""


class _HashedFile:
    """A file whose SHA-256 is known as far as it was read."""

    def __init__(self, file: BufferedReader, *, used: bool) -> None:
        self._file, self._used, self._sha256 = file, used, hashlib.sha256()

    def read(self, size: int = -1) -> bytes:
        """Some bytes, fewer at the end."""
        # No more than there are, as room is made before they are found.
        left = max(os.fstat(self._file.fileno()).st_size - self._file.tell(), 0)
        content = self._file.read(left if size < 0 else min(size, left))
        if self._used:
            self._sha256.update(content)
        return content

    def digest(self) -> str:
        """Of what was read so far."""
        return self._sha256.hexdigest()

    @property
    def closed(self) -> bool:
        """Whether it is closed."""
        return self._file.closed

    def close(self) -> None:
        """Closes it."""
        self._file.close()


def _place(batch: int, tick: int) -> str:
    return f"batch {batch} (from tick {tick})"


def _rows(batch: pa.RecordBatch | None) -> int:
    return 0 if batch is None else int(batch.num_rows)


def stream_log(path: Path) -> Iterator[pa.RecordBatch]:
    """The batches of a log one by one, up to the first that is not as a run wrote it.

    Raises:
        OSError: the file cannot be opened.
    """
    yield from LogReader(path)


def read_log(path: Path) -> History:
    """The ticks of a log, up to the first batch that is not as a run wrote it.

    Raises:
        OSError: the file cannot be opened.
    """
    columns = HistoryBuilder()
    for batch in stream_log(path):
        columns.add(batch)
    return columns.build()
