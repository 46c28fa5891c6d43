"""The messages of an MCAP file, a chunk at a time: where each is, by its channel.

The framing of records is read here, so that a message costs no Python; records other than messages
are those of the library mcap.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from functools import reduce
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.missing import library
from taskspec_runner.export.chunks import (
    FOOTER,
    LOG_TIME,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    MESSAGE_INDEX,
)

#: Opcodes.
_SCHEMA, _CHANNEL, _CHUNK, _DATA_END = 0x03, 0x04, 0x06, 0x0F
_RECORD = struct.Struct("<BQ")
#: Bytes of a message before its content.
_HEAD = MESSAGE_HEAD.size
#: Bytes of messages outside of chunks that are taken together.
_LOOSE = 1 << 20


class DamagedFileError(Exception):
    """A file that is no whole MCAP file; the message says why."""


@dataclass(frozen=True, slots=True)
class ChannelMessages:
    """Messages of one topic and definition that stand in one chunk, in their order.

    Attributes:
        channel, schema: records of the library, the first one's of several senders; no schema for
            a channel that has none.
        content: bytes of the chunk.
        starts, ends: (n,) where the data of each message begin and end.
        times: (n,) when each was logged [ns].
    """

    channel: Any
    schema: Any
    content: bytes
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]
    times: NDArray[np.int64]

    def of_rows(self, rows: NDArray[np.int64]) -> NDArray[np.uint8]:
        """(k, size) bytes of some messages, which are of one length."""
        starts = self.starts[rows]
        size = int(self.ends[rows[0]] - starts[0])
        steps = np.diff(starts)
        if len(steps) and (steps == steps[0]).all():
            step = int(steps[0])
            return np.ndarray(
                (len(rows), size), np.uint8, self.content, int(starts[0]), (step, 1)
            )  # fmt: skip
        data = b"".join([self.content[start : start + size] for start in starts.tolist()])
        return np.frombuffer(data, np.uint8).reshape(len(rows), size)


class ChunkReader:
    """A file, read from its beginning to its end."""

    def __init__(self, file: IO[bytes]) -> None:
        """Takes a file.

        Raises:
            MissingLibraryError: the library mcap is not installed.
        """
        self._file, self._crc = file, 0
        self._records = library("mcap.records", "MCAP")
        self._stream = library("mcap.data_stream", "MCAP").ReadDataStream
        self._unpacked = library("mcap.stream_reader", "MCAP").get_chunk_data_stream
        self._schemas, self._channels = dict[int, Any](), dict[int, Any]()

    def __iter__(self) -> Iterator[ChannelMessages]:
        """The messages of each topic in each chunk.

        Raises:
            DamagedFileError: the file is cut short, or a checksum is another one.
            Exception: whatever else the library lets through of a damaged record.
        """
        size = self._file.seek(0, io.SEEK_END)
        self._file.seek(0)
        if self._take(len(MAGIC)) != MAGIC:
            raise DamagedFileError("it does not begin as one")
        chunk, index, loose, opcode = b"", list[bytes](), bytearray(), 0
        while opcode != FOOTER:
            crc = self._crc
            opcode, length = _RECORD.unpack(self._take(_RECORD.size))
            if length > size - self._file.tell():
                raise DamagedFileError("a record is cut short")
            content = self._take(length)
            if opcode == MESSAGE_INDEX:
                index.append(content)
                continue
            if chunk:
                yield from self._messages(chunk, index)
            chunk, index = self._chunk(content) if opcode == _CHUNK else b"", []
            if opcode == MESSAGE:
                loose += _RECORD.pack(opcode, length) + content
            if loose and (opcode != MESSAGE or len(loose) >= _LOOSE):
                yield from self._messages(bytes(loose), [])
                loose.clear()
            self._define(opcode, content)
            self._check(opcode, content, crc)
        if self._take(len(MAGIC)) != MAGIC:
            raise DamagedFileError("it does not end as one")

    def _chunk(self, content: bytes) -> bytes:
        """The records of a chunk."""
        read = self._records.Chunk.read(self._stream(io.BytesIO(content)))
        stream, length = self._unpacked(read, validate_crc=True)
        found: bytes = stream.read(length)
        return found

    def _check(self, opcode: int, content: bytes, crc: int) -> None:
        """Compares the checksums of data and summary, of all that stands before them."""
        stream = self._stream(io.BytesIO(content))
        if opcode == _DATA_END:
            stated, what, self._crc = self._records.DataEnd.read(stream).data_section_crc, "data", 0
        elif opcode == FOOTER:
            stated, what = self._records.Footer.read(stream).summary_crc, "summary"
            crc = zlib.crc32(_RECORD.pack(opcode, len(content)) + content[:-4], crc)
        else:
            return
        if stated not in (0, crc):
            raise DamagedFileError(f"the checksum of its {what} is another one")

    def _take(self, length: int) -> bytes:
        """The next bytes of the file."""
        content = self._file.read(length)
        if len(content) < length:
            raise DamagedFileError("it is cut short")
        self._crc = zlib.crc32(content, self._crc)
        return content

    def _define(self, opcode: int, content: bytes) -> None:
        """Takes a schema or a channel; a later one does not replace an earlier one."""
        stream = self._stream(io.BytesIO(content))
        if opcode == _SCHEMA:
            schema = self._records.Schema.read(stream)
            self._schemas.setdefault(schema.id, schema)
        elif opcode == _CHANNEL:
            channel = self._records.Channel.read(stream)
            self._channels.setdefault(channel.id, channel)

    def _messages(self, content: bytes, index: Sequence[bytes]) -> Iterator[ChannelMessages]:
        starts_of = self._starts(content, index)
        if not len(starts_of):
            return
        lengths, channels, times = (
            _field(content, starts_of + at, dtype)
            for at, dtype in ((1, "<u8"), (9, "<u2"), (LOG_TIME, "<i8"))
        )
        ends = starts_of + _RECORD.size + lengths.astype(np.int64)
        same: dict[tuple[str, str, int], list[int]] = {}
        for number in dict.fromkeys(channels.tolist()):
            if number not in self._channels:
                raise DamagedFileError(f"messages are of a channel {number}, which it has not")
            channel = self._channels[number]
            key = channel.topic, channel.message_encoding, channel.schema_id
            same.setdefault(key, []).append(number)
        for numbers in same.values():
            rows = np.flatnonzero(reduce(np.logical_or, (channels == each for each in numbers)))
            channel = self._channels[numbers[0]]
            schema = self._schemas.get(channel.schema_id)
            starts = starts_of[rows] + _HEAD
            yield ChannelMessages(channel, schema, content, starts, ends[rows], times[rows])

    def _starts(self, content: bytes, index: Sequence[bytes]) -> NDArray[np.int64]:
        """(n,) where the messages of a chunk begin.

        Those that its index has are taken all at once, if they fill the chunk from one to the
        next; what lies between them is read record by record.
        """
        entries = [np.frombuffer(each, "<u8", offset=6).reshape(-1, 2)[:, 1] for each in index]
        known = np.sort(np.concatenate(entries)).astype(np.int64) if entries else _NONE
        known = known[(known >= 0) & (known <= len(content) - _HEAD)]
        if len(known):
            lengths = _field(content, known + 1, "<u8")
            right = (np.frombuffer(content, np.uint8)[known] == MESSAGE) & (lengths < 1 << 40)
            known, ends = known[right], (known + _RECORD.size + lengths.astype(np.int64))[right]
        if not len(known):
            return np.array([*self._walked(content, 0, len(content))], dtype=np.int64)
        apart = np.flatnonzero(known[1:] != ends[:-1])
        gaps = [(0, int(known[0])), (int(ends[-1]), len(content))]
        gaps += [(int(ends[i]), int(known[i + 1])) for i in apart]
        between = [each for begin, end in gaps for each in self._walked(content, begin, end)]
        return np.sort(np.concatenate([known, np.array(between, dtype=np.int64)]))

    def _walked(self, content: bytes, at: int, end: int) -> Iterator[int]:
        """Where messages begin in a part of a chunk; what else is there is taken."""
        while at < end:
            if end - at < _RECORD.size:
                raise DamagedFileError("a record of a chunk is cut short")
            opcode, length = _RECORD.unpack_from(content, at)
            after = at + _RECORD.size + length
            if after > end or (opcode == MESSAGE and length < _HEAD - _RECORD.size):
                raise DamagedFileError("a record of a chunk is cut short")
            if opcode == MESSAGE:
                yield at
            self._define(opcode, content[at + _RECORD.size : after])
            at = after
        if at > end:
            raise DamagedFileError("its index does not fit its chunks")


_NONE = np.empty(0, dtype=np.int64)


def _field(content: bytes, at: NDArray[np.int64], dtype: str) -> NDArray[Any]:
    """(n,) numbers that stand in a chunk, at any places."""
    kind = np.dtype(dtype)
    everywhere = np.ndarray((len(content) - kind.itemsize + 1,), kind, content, 0, (1,))
    found: NDArray[Any] = everywhere[at]
    return found
