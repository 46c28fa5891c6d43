"""The log of a run on the disk: an Arrow IPC stream, in batches that survive a killed run."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from taskspec_runner.errors import OutputError
from taskspec_runner.record.history import History, HistoryBuilder


class Log:
    """The log of a run that goes on: every batch on the disk at once, and its columns in memory.

    Args:
        path: of the file.
        keep: whether columns are kept in memory.
    """

    def __init__(self, path: Path, *, keep: bool = True) -> None:
        self._path, self._written = path, 0
        self._file = path.open("xb", buffering=0)
        self._sha256 = hashlib.sha256()
        # A batch is many small pieces: they are put together, hashed and written as one.
        self._pieces = io.BytesIO()
        self._failure: OutputError | None = None
        self._writer: pa.ipc.RecordBatchStreamWriter | None = None
        self._columns, self._keep = HistoryBuilder(), keep

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
        self._writer.write_batch(batch)
        self._append()
        if self._keep:
            self._columns.add(batch)

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
            # What is there of a batch that is not complete would only be in the way.
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

    def history(self) -> History:
        """Every tick that was written; it leaves none here, so that they are in memory once."""
        return self._columns.build()


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


def read_log(path: Path) -> History:
    """The ticks of a log; of one that was cut short, up to its last complete batch.

    Raises:
        OSError: the file cannot be opened.
    """
    columns = HistoryBuilder()
    for batch in stream_log(path):
        columns.add(batch)
    return columns.build()
