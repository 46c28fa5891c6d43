"""An MCAP log of ROS 2 messages as columns: every number of every message, by topic and field.

Messages are CDR, whose fields stand where their definition says. Where all messages of a topic have
the same lengths of texts and lists, a field has one place in all of them, and is read at once.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import InputError
from taskspec_runner.export.missing import library
from taskspec_runner.record.file_array import blocks
from taskspec_runner.record.folder import parse_json
from taskspec_runner.record.mapped import KeptArrays, gathered
from taskspec_runner.record.whole import open_regular
from taskspec_runner.recorded.sample_texts import SampleTexts, SampleTextsBuilder

Vector = NDArray[np.float64]

MAGIC = b"\x89MCAP0\r\n"
_SIZES = {
    "bool": "u1", "byte": "u1", "char": "u1", "uint8": "u1", "int8": "i1", "uint16": "u2",
    "int16": "i2", "uint32": "u4", "int32": "i4", "uint64": "u8", "int64": "i8", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
_FIELD = re.compile(r"\A([\w/]+)(?:<=\d+)?(\[(?:<=)?(\d*)\])?\s+(\w+)\s*(=?)")
#: Units of messages that ROS 2 defines (REP 103), by what their fields begin with.
_SI = {
    "JointState": {"position": "rad", "velocity": "rad/s", "effort": "N*m"},
    "WrenchStamped": {"wrench.force": "N", "wrench.torque": "N*m"},
    "Wrench": {"force": "N", "torque": "N*m"},
    "TwistStamped": {"twist.linear": "m/s", "twist.angular": "rad/s"},
    "Twist": {"linear": "m/s", "angular": "rad/s"},
    "PoseStamped": {"pose.position": "m"},
    "Pose": {"position": "m"},
}
#: Numbers that one list may bring as columns; a longer one is a picture or a point cloud.
_LONGEST_LIST = 64
#: Messages of a topic that are taken apart at a time, and how many bytes of them.
_MESSAGES, _WAITING = 1 << 14, 1 << 23


class _TornError(Exception):
    """A message ends before its last field."""


@dataclass(slots=True)
class _Layout:
    """Where the fields of a message stand.

    Attributes:
        numbers: path to offset and type.
        texts: path to offset and length [bytes].
        counts: offset of each length to it, which other messages must have too.
    """

    numbers: dict[str, tuple[int, str]] = field(default_factory=dict)
    texts: dict[str, tuple[int, int]] = field(default_factory=dict)
    counts: dict[int, int] = field(default_factory=dict)


class _Definition:
    """A message of ROS 2, from its text."""

    def __init__(self, name: str, text: str) -> None:
        self._kinds: dict[str, list[tuple[str, bool, int | None, str]]] = {}
        parts = re.split(r"^=+\s*$", text, flags=re.M)
        self._root = name
        self._kinds[name] = _fields(parts[0])
        for part in parts[1:]:
            head, _, body = part.strip().partition("\n")
            self._kinds[head.removeprefix("MSG:").strip()] = _fields(body)

    def layout(self, data: bytes) -> _Layout:
        """Where the fields of one message stand.

        Raises:
            _TornError: it ends early.
        """
        walk = _Walk(self._kinds, data)
        try:
            walk.message(self._root, "")
        except struct.error as error:
            raise _TornError from error
        if walk.at > len(data):
            raise _TornError
        return walk.layout


class _Walk:
    def __init__(
        self, kinds: Mapping[str, list[tuple[str, bool, int | None, str]]], data: bytes
    ) -> None:
        self._kinds, self._data, self.at = kinds, data, 4
        self.layout = _Layout()

    def message(self, kind: str, path: str) -> None:
        fields = self._kinds.get(kind)
        if fields is None:
            short = kind.replace("/msg/", "/")
            near = (name for name in self._kinds if name.rpartition("/")[2] == short)
            fields = self._kinds.get(short) or self._kinds.get(next(near, ""))
        if fields is None:
            raise InputError(f"the definition of message {kind} is missing")
        for own, listed, count, name in fields:
            where = f"{path}.{name}" if path else name
            if not listed:
                self._one(own, where)
                continue
            number = self._count() if count is None else count
            for i in range(number):
                self._one(own, f"{where}[{i}]" if number <= _LONGEST_LIST else "")

    def _one(self, kind: str, path: str) -> None:
        if kind in _SIZES:
            size = int(_SIZES[kind][1])
            self._align(size)
            if path:
                self.layout.numbers[path] = (self.at, _SIZES[kind])
            self.at += size
        elif kind in ("string", "wstring"):
            length = self._count()
            if path:
                self.layout.texts[path] = (self.at, max(length - 1, 0))
            self.at += length
        else:
            self.message(kind, path)

    def _count(self) -> int:
        self._align(4)
        (number,) = struct.unpack_from("<I", self._data, self.at)
        if number > len(self._data):
            raise _TornError
        self.layout.counts[self.at] = number
        self.at += 4
        return int(number)

    def _align(self, to: int) -> None:
        # Alignment counts from behind the four bytes of the encapsulation.
        self.at += -(self.at - 4) % to


def _fields(text: str) -> list[tuple[str, bool, int | None, str]]:
    found = []
    for line in text.splitlines():
        match = _FIELD.match(line.partition("#")[0].strip())
        if match and not match[5]:
            count = int(match[3]) if match[2] and match[3] and "<=" not in match[2] else None
            found.append((match[1], bool(match[2]), count, match[4]))
    return found


class MessageLog:
    """The columns of an MCAP file, such as `/wrench.wrench.force.z`."""

    timed, form = True, "MCAP"

    def __init__(self, path: Path, topics: Mapping[str, _Topic], units: Mapping[str, str]) -> None:
        """Takes the topics of a file and the units of their fields, by topic and field."""
        self.path, self.units, self._topics = path, units, topics

    def _field(self, name: str) -> tuple[_Topic, str]:
        topic = next(t for t in self._topics if name.startswith(f"{t}.") and name in self.units)
        return self._topics[topic], name.removeprefix(f"{topic}.")

    def numbers(self, names: Sequence[str]) -> dict[str, Vector]:
        """(n,) values of fields in all messages of their topics."""
        found = {}
        for name in names:
            topic, field_name = self._field(name)
            if field_name in topic.texts:
                raise InputError(f"{self.path}: field '{name}' is not of numbers")
            found[name] = topic.numbers[field_name].values(np.float64)
        return found

    def words(self, name: str) -> SampleTexts:
        """Values of a field as texts."""
        topic, field_name = self._field(name)
        if field_name in topic.texts:
            return topic.texts[field_name].words(f"{self.path}: field '{name}'")
        builder, values = SampleTextsBuilder(), topic.numbers[field_name].values(np.float64)
        for part in blocks(len(values)):
            builder.add([f"{value:g}" for value in values[part].tolist()])
        return builder.words(f"{self.path}: field '{name}'")

    def times(self, name: str) -> Vector:
        """(n,) times of its messages, since the first message of the log [s]."""
        topic, field_name = self._field(name)
        return topic.times(field_name)

    def place(self, name: str, row: int) -> str:
        """The number of a message."""
        return f"message {row + 1} of {name.partition('.')[0]}"


class _Grown:
    """Arrays (n,) that are one, put away."""

    def __init__(self, kept: KeptArrays) -> None:
        self._kept, self._parts, self.count = kept, list[Callable[[], NDArray[Any]]](), 0

    def add(self, values: NDArray[Any]) -> None:
        self._parts.append(self._kept.put(np.ascontiguousarray(values)))
        self.count += len(values)

    def count_on(self, first: int, count: int) -> None:
        """Adds numbers that follow each other."""
        self._parts.append(lambda: np.arange(first, first + count))
        self.count += count

    def values(self, dtype: Any) -> NDArray[Any]:
        return gathered((part() for part in self._parts), self.count, np.dtype(dtype))


class _Topic:
    """The messages of one topic, some at a time.

    Attributes:
        numbers: fields to their values.
        texts: fields to their words.
        first: time stamp of the first message [ns].
        begin: time stamp from which times count [ns].
    """

    def __init__(self, definition: _Definition, kept: KeptArrays) -> None:
        self.numbers: dict[str, _Grown] = {}
        self.texts: dict[str, SampleTextsBuilder] = {}
        self._definition, self._kept = definition, kept
        self._stamps = _Grown(kept)
        #: Numbers of the messages that a field is in.
        self._rows: dict[str, _Grown] = {}
        self._waiting: list[bytes] = []
        self._waiting_stamps: list[int] = []
        self._bytes, self.first, self.begin = 0, 0, 0
        self._times: dict[str, Vector] = {}

    def add(self, stamp: int, data: bytes) -> None:
        """Takes a message.

        Raises:
            _TornError: it, or one before, ends early.
        """
        if not self._stamps.count and not self._waiting:
            self.first = stamp
        self._waiting_stamps.append(stamp)
        self._waiting.append(data)
        self._bytes += len(data)
        if len(self._waiting) == _MESSAGES or self._bytes > _WAITING:
            self.finish()

    def finish(self) -> None:
        """Takes the fields out of the messages that wait."""
        before, data = self._stamps.count, self._waiting
        for name, rows, values in _fields_of(self._definition, data):
            if isinstance(values, list):
                self.texts.setdefault(name, SampleTextsBuilder()).add(values)
            else:
                self.numbers.setdefault(name, _Grown(self._kept)).add(values)
            having = self._rows.setdefault(name, _Grown(self._kept))
            if len(rows) == len(data):
                having.count_on(before, len(data))
            else:
                having.add(before + rows)
        if data:
            self._stamps.add(np.array(self._waiting_stamps, dtype=np.int64))
        self._waiting, self._waiting_stamps, self._bytes = [], [], 0

    @property
    def fields(self) -> Iterator[str]:
        """Of all its messages."""
        return iter(self._rows)

    def times(self, name: str) -> Vector:
        """(n,) times of the messages with a field [s]; the same array for fields of all of them."""
        every = self._rows[name].count == self._stamps.count
        key = "" if every else name
        if key not in self._times:
            times = (self._stamps.values(np.int64) - self.begin) / 1e9
            self._times[key] = times if every else times[self._rows[name].values(np.int64)]
        return self._times[key]


def _messages(path: Path) -> Iterator[tuple[Any, Any, Any]]:
    """Schema, channel and message of each message of a file.

    Raises:
        InputError: it is no whole MCAP file.
    """
    make_reader = library("mcap.reader", "MCAP", "mcap").make_reader
    try:
        with open_regular(path) as file:
            yield from make_reader(file, validate_crcs=True).iter_messages()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except Exception as error:
        # The library lets through whatever its decompressors and unpackers raise.
        said = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"cannot read {path}: it is no whole MCAP file ({said})") from error


def _stated(path: Path, channel: Any) -> Mapping[str, Any]:
    """The units that a channel states."""
    try:
        return parse_json(channel.metadata.get("units", "{}").encode())
    except (RecursionError, ValueError) as error:
        raise InputError(f"cannot read {path}: units of {channel.topic} are no JSON") from error


def read_mcap(path: Path) -> MessageLog:
    """An MCAP file of ROS 2 messages; times are those at which they were logged.

    Raises:
        MissingLibraryError: the library mcap is not installed.
        InputError: it is no such file, cut short, or without a message that can be read.
    """
    library("mcap.reader", "MCAP", "mcap")
    topics: dict[str, tuple[Any, Any, _Topic]] = {}
    kept, topic = KeptArrays(), ""
    try:
        for schema, channel, message in _messages(path):
            if schema is not None and schema.encoding == "ros2msg":
                topic = channel.topic
                if topic not in topics:
                    definition = _Definition(schema.name, schema.data.decode())
                    topics[topic] = schema, channel, _Topic(definition, kept)
                topics[topic][2].add(message.log_time, message.data)
        for topic in topics:
            topics[topic][2].finish()
    except _TornError:
        raise InputError(f"cannot read {path}: a message of {topic} is cut short") from None
    except (RecursionError, ValueError) as error:
        said = " ".join(str(error).split())
        raise InputError(
            f"cannot read {path}: {topic} has a damaged definition ({said})"
        ) from error
    if not topics:
        raise InputError(f"cannot read {path}: it holds no message of ROS 2 (ros2msg, CDR)")
    begin = min(own.first for _, _, own in topics.values())
    units: dict[str, str] = {}
    for topic, (schema, channel, own) in topics.items():
        own.begin = begin
        stated = _stated(path, channel)
        known = _SI.get(schema.name.rpartition("/")[2], {})
        for name in own.fields:
            usual = (unit for begins, unit in known.items() if name.startswith(begins))
            units[f"{topic}.{name}"] = str(stated.get(name, "")) or next(usual, "")
    return MessageLog(path, {topic: own for topic, (_, _, own) in topics.items()}, units)


def _fields_of(
    definition: _Definition, data: Sequence[bytes]
) -> Iterator[tuple[str, NDArray[np.int64], Any]]:
    """Each field of some messages: those that have it, in order, and its values in them."""
    rows = np.arange(len(data))
    parts: dict[str, list[tuple[NDArray[np.int64], Any]]] = {}
    while len(rows):
        # All messages with the lengths of the first are read at once, then the rest.
        first = data[rows[0]]
        layout = definition.layout(first)
        same = np.array([len(data[row]) == len(first) for row in rows.tolist()])
        block = np.frombuffer(b"".join(data[row] for row in rows[same].tolist()), dtype=np.uint8)
        block = block.reshape(-1, len(first))
        fits = np.ones(len(block), dtype=bool)
        for at, number in layout.counts.items():
            fits &= _read(block, at, "u4") == number
        chosen = rows[same][fits]
        for name, (at, kind) in layout.numbers.items():
            values = _read(block[fits], at, kind).astype(float)
            parts.setdefault(name, []).append((chosen, values))
        for name, (at, length) in layout.texts.items():
            texts = np.ascontiguousarray(block[fits, at : at + length]).tobytes()
            words = [
                texts[i * length : (i + 1) * length].decode("utf-8", "replace")
                for i in range(len(chosen))
            ]
            parts.setdefault(name, []).append((chosen, words))
        rows = np.concatenate([rows[same][~fits], rows[~same]])
        rows.sort()
    for name, found in parts.items():
        yield name, *_joined(found)


def _read(block: NDArray[np.uint8], at: int, kind: str) -> NDArray[Any]:
    size = int(kind[1])
    return np.ascontiguousarray(block[:, at : at + size]).view(f"<{kind}")[:, 0]


def _joined(parts: Sequence[tuple[NDArray[np.int64], Any]]) -> tuple[NDArray[np.int64], Any]:
    rows = np.concatenate([chosen for chosen, _ in parts])
    order = np.argsort(rows, kind="stable")
    if isinstance(parts[0][1], list):
        words = [word for _, part in parts for word in part]
        return rows[order], [words[i] for i in order.tolist()]
    return rows[order], np.concatenate([part for _, part in parts])[order]
