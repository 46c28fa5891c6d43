"""An MCAP file that is written by chunks of messages, of which each channel's are a column.

Records other than messages are those of the library mcap; its writer takes messages one by one.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.missing import library
from taskspec_runner.export.cdr import Bytes, MessageForm, bytes_of

MAGIC = b"\x89MCAP0\r\n"
#: Bytes of messages in a chunk, which a reader of an unfinished file may lose.
_CHUNK = 1 << 21
#: Of zstd's; higher ones take longer than all the rest, for files that are a twentieth smaller.
_LEVEL = 1
#: Opcodes.
MESSAGE, MESSAGE_INDEX, FOOTER = 0x05, 0x07, 0x02
#: Opcode, length, channel, sequence, and the times of log and publication [ns] of a message.
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
LOG_TIME, _PUBLISHED = 15, 23
#: Opcode, length, channel, and bytes of the entries of a message index.
_INDEX = struct.Struct("<BQHI")
#: Opcode and length of a footer, and where the summary and its offsets begin.
_FOOTER_START = struct.Struct("<BQQQ")


@dataclass(frozen=True, slots=True)
class ChannelColumn:
    """A message of one channel at each of some ticks.

    Attributes:
        channel: its number.
        layout: of the messages.
        slots: (n, ...) what fills them.
    """

    channel: int
    layout: MessageForm
    slots: Sequence[NDArray[Any]] = ()


class ChunkedFile:
    """An MCAP file, written from its beginning to its end."""

    def __init__(self, file: IO[bytes], profile: str, writer: str) -> None:
        """Begins a file.

        Raises:
            MissingLibraryError: the library mcap is not installed.
        """
        self._file, self._at, self._crc, self._opcode = file, 0, 0, 0
        self._records = library("mcap.records", "MCAP")
        self._builder = library("mcap.data_stream", "MCAP").RecordBuilder()
        self._compress = library("zstandard", "MCAP").ZstdCompressor(_LEVEL).compress
        self._schemas, self._channels = list[Any](), list[Any]()
        self._chunks, self._attachments, self._metadata = list[Any](), list[Any](), list[Any]()
        self._messages: Counter[int] = Counter()
        #: Lays out, packs and writes messages, one call after the other.
        self._worker = ThreadPoolExecutor(1)
        self._working: Future[None] | None = None
        #: Bytes of the messages that wait for their chunk.
        self._room, self._size = np.empty(_CHUNK, dtype=np.uint8), 0
        #: Times [ns] and places in the chunk of the messages that wait, by channel.
        self._index: dict[int, list[NDArray[np.uint64]]] = {}
        self._put(MAGIC)
        self._write(self._records.Header(profile, writer))

    def schema(self, name: str, text: str) -> int:
        """The number of a message's definition."""
        kind, number = self._records.Schema, len(self._schemas) + 1
        made = kind(id=number, data=text.encode(), encoding="ros2msg", name=name)
        self._schemas.append(made)
        self._write(made)
        return number

    def channel(self, topic: str, schema: int, metadata: Mapping[str, str]) -> int:
        """The number of a channel of messages in CDR."""
        number = len(self._channels) + 1
        kind = self._records.Channel
        made = kind(
            id=number,
            topic=topic,
            message_encoding="cdr",
            metadata=dict(metadata),
            schema_id=schema,
        )
        self._channels.append(made)
        self._write(made)
        return number

    def add(self, times: NDArray[np.int64], columns: Sequence[ChannelColumn]) -> None:
        """Takes messages tick by tick: of each the columns in order.

        They are written by a thread of their own, and are not to be changed any more.

        Args:
            times: (n,) of the ticks [ns].
            columns: of n messages each.
        """
        working = self._worker.submit(self._lay_out, times, columns)
        self._settle()
        self._working = working

    def _settle(self) -> None:
        """Waits for what was taken before; raises what it raised."""
        if self._working is not None:
            self._working.result()
            self._working = None

    def _lay_out(self, times: NDArray[np.int64], columns: Sequence[ChannelColumn]) -> None:
        """Puts messages into chunks."""
        templates = [column.layout.template for column in columns]
        heads = [
            MESSAGE_HEAD.pack(
                MESSAGE, MESSAGE_HEAD.size - 9 + len(template), column.channel, 0, 0, 0
            )
            for column, template in zip(columns, templates, strict=True)
        ]
        parts = [part for both in zip(heads, templates, strict=True) for part in both]
        tick = np.frombuffer(b"".join(parts), dtype=np.uint8)
        step = max(_CHUNK // len(tick), 1)
        for first in range(0, len(times), step):
            rows = slice(first, first + step)
            now = times[rows].astype("<u8")
            made = self._place(len(now), len(tick))
            made[:] = tick
            starts = self._size + len(tick) * np.arange(len(now), dtype=np.uint64)
            at = 0
            for column, template in zip(columns, templates, strict=True):
                for place in (at + LOG_TIME, at + _PUBLISHED):
                    made[:, place : place + 8] = bytes_of(now)
                entries = np.column_stack([now, starts + np.uint64(at)])
                self._index.setdefault(column.channel, []).append(entries)
                at += MESSAGE_HEAD.size
                slots = [values[rows] for values in column.slots]
                column.layout.fill(made[:, at : at + len(template)], slots)
                at += len(template)
            self._size += made.size

    def _place(self, rows: int, size: int) -> Bytes:
        """(rows, size) bytes of the chunk that waits, or of a new one if they do not fit in it."""
        if self._size + rows * size > len(self._room):
            self._chunk()
            if rows * size > len(self._room):
                self._room = np.empty(rows * size, dtype=np.uint8)
        return self._room[self._size : self._size + rows * size].reshape(rows, size)

    def attach(self, name: str, kind: str, content: bytes) -> None:
        """Writes a file within the file."""
        self._chunks_end()
        made = self._records.Attachment(0, 0, name, kind, content)
        at, length = self._write(made)
        index = self._records.AttachmentIndex
        self._attachments.append(index(at, length, 0, 0, len(content), name, kind))

    def state(self, name: str, facts: Mapping[str, str]) -> None:
        """Writes metadata of the whole file."""
        self._chunks_end()
        at, length = self._write(self._records.Metadata(name, dict(facts)))
        self._metadata.append(self._records.MetadataIndex(at, length, name))

    def finish(self) -> None:
        """Writes what stands at the end: all that finds a message without reading the others."""
        self._chunks_end()
        self._worker.shutdown()
        records = self._records
        self._write(records.DataEnd(self._crc))
        start, self._crc = self._at, 0
        groups = (
            self._schemas, self._channels, [self._statistics()],
            self._chunks, self._attachments, self._metadata,
        )  # fmt: skip
        offsets = []
        for group in filter(None, groups):
            first = self._at
            for record in group:
                self._write(record)
            offsets.append(records.SummaryOffset(self._opcode, first, self._at - first))
        of_offsets = self._at
        for record in offsets:
            self._write(record)
        head = _FOOTER_START.pack(FOOTER, _FOOTER_START.size - 9 + 4, start, of_offsets)
        self._write(records.Footer(start, of_offsets, zlib.crc32(head, self._crc)))
        self._put(MAGIC)

    def _statistics(self) -> Any:
        return self._records.Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self._messages),
            chunk_count=len(self._chunks),
            message_count=self._messages.total(),
            metadata_count=len(self._metadata),
            message_start_time=min((c.message_start_time for c in self._chunks), default=0),
            message_end_time=max((c.message_end_time for c in self._chunks), default=0),
            schema_count=len(self._schemas),
        )

    def _chunks_end(self) -> None:
        """Writes all messages so far."""
        self._settle()
        self._chunk()

    def _chunk(self) -> None:
        """Writes the messages that wait, and where each of them is."""
        if not self._size:
            return
        content = self._room[: self._size].data
        index = {channel: np.concatenate(parts) for channel, parts in self._index.items()}
        self._size, self._index = 0, {}
        chunk = self._records.Chunk(
            compression="zstd",
            data=self._compress(content),
            message_start_time=min(int(entries[:, 0].min()) for entries in index.values()),
            message_end_time=max(int(entries[:, 0].max()) for entries in index.values()),
            uncompressed_crc=zlib.crc32(content),
            uncompressed_size=len(content),
        )
        at, length = self._write(chunk)
        after, offsets = self._at, {}
        for channel, entries in index.items():
            offsets[channel] = self._at
            data = entries.astype("<u8").tobytes()
            head = _INDEX.pack(MESSAGE_INDEX, _INDEX.size - 9 + len(data), channel, len(data))
            self._put(head + data)
            self._messages[channel] += len(entries)
        self._chunks.append(
            self._records.ChunkIndex(
                chunk_start_offset=at,
                chunk_length=length,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                uncompressed_size=chunk.uncompressed_size,
                message_start_time=chunk.message_start_time,
                message_end_time=chunk.message_end_time,
                message_index_offsets=offsets,
                message_index_length=self._at - after,
            )
        )

    def _write(self, record: Any) -> tuple[int, int]:
        """Writes a record of the library; returns where it begins and its length [bytes]."""
        record.write(self._builder)
        content, at = self._builder.end(), self._at
        self._opcode = content[0]
        self._put(content)
        return at, len(content)

    def _put(self, content: bytes) -> None:
        self._file.write(content)
        self._crc = zlib.crc32(content, self._crc)
        self._at += len(content)
