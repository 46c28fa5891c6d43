"""An MCAP log of ROS 2 messages as columns: every number of every message, by topic and field.

Messages are CDR, whose fields stand where their definition says. Where all messages of a topic have
the same lengths of texts and lists, a field has one place in all of them, and is read at once.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import InputError
from taskspec_runner.export.missing import library

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
_LONGEST = 64


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
                self._one(own, f"{where}[{i}]" if number <= _LONGEST else "")

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

    def __init__(
        self, path: Path, columns: Mapping[str, _Column], units: Mapping[str, str]
    ) -> None:
        self.path, self.units, self._columns = path, units, columns

    def numbers(self, name: str) -> Vector:
        """(n,) values of a field in all messages of its topic."""
        values = self._columns[name].values
        if isinstance(values, list):
            raise InputError(f"{self.path}: field '{name}' is not of numbers")
        return values

    def words(self, name: str) -> Sequence[str]:
        """Values of a field as texts."""
        values = self._columns[name].values
        return values if isinstance(values, list) else [f"{v:g}" for v in values.tolist()]

    def times(self, name: str) -> Vector:
        """(n,) times of its messages, since the first message of the log [s]."""
        return self._columns[name].times

    def place(self, name: str, row: int) -> str:
        """The number of a message."""
        return f"message {row + 1} of {name.partition('.')[0]}"


@dataclass(frozen=True, slots=True)
class _Column:
    times: Vector
    values: Vector | list[str]


def read_mcap(path: Path) -> MessageLog:
    """An MCAP file of ROS 2 messages; times are those at which they were logged.

    Raises:
        MissingLibraryError: the library mcap is not installed.
        InputError: it is no such file, cut short, or without a message that can be read.
    """
    make_reader = library("mcap.reader", "MCAP", "mcap").make_reader
    errors = library("mcap.exceptions", "MCAP", "mcap").McapError
    topics: dict[str, tuple[Any, Any, list[int], list[bytes]]] = {}
    try:
        with path.open("rb") as file:
            reader = make_reader(file, validate_crcs=True)
            for schema, channel, message in reader.iter_messages():
                if schema is not None and schema.encoding == "ros2msg":
                    own = topics.setdefault(channel.topic, (schema, channel, [], []))
                    own[2].append(message.log_time)
                    own[3].append(message.data)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except (errors, struct.error, ValueError, EOFError, KeyError) as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"cannot read {path}: it is no whole MCAP file ({said})") from error
    if not topics:
        raise InputError(f"cannot read {path}: it holds no message of ROS 2 (ros2msg, CDR)")
    begin = min(times[0] for _, _, times, _ in topics.values())
    columns: dict[str, _Column] = {}
    units: dict[str, str] = {}
    for topic, (schema, channel, stamps, data) in topics.items():
        times = (np.array(stamps, dtype=np.int64) - begin) / 1e9
        try:
            fields = _topic(_Definition(schema.name, schema.data.decode()), times, data)
        except _TornError:
            raise InputError(f"cannot read {path}: a message of {topic} is cut short") from None
        columns |= {f"{topic}.{name}": column for name, column in fields.items()}
        stated = json.loads(channel.metadata.get("units", "{}"))
        known = _SI.get(schema.name.rpartition("/")[2], {})
        for name in fields:
            usual = (unit for begins, unit in known.items() if name.startswith(begins))
            units[f"{topic}.{name}"] = str(stated.get(name, "")) or next(usual, "")
    return MessageLog(path, columns, units)


def _topic(definition: _Definition, times: Vector, data: Sequence[bytes]) -> dict[str, _Column]:
    """Field to its values in messages of one topic."""
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
    return {name: _joined(times, found) for name, found in parts.items()}


def _read(block: NDArray[np.uint8], at: int, kind: str) -> NDArray[Any]:
    size = int(kind[1])
    return np.ascontiguousarray(block[:, at : at + size]).view(f"<{kind}")[:, 0]


def _joined(times: Vector, parts: Sequence[tuple[NDArray[np.int64], Any]]) -> _Column:
    rows = np.concatenate([chosen for chosen, _ in parts])
    order = np.argsort(rows, kind="stable")
    if isinstance(parts[0][1], list):
        words = [word for _, part in parts for word in part]
        return _Column(times[rows[order]], [words[i] for i in order.tolist()])
    return _Column(times[rows[order]], np.concatenate([part for _, part in parts])[order])
