"""An MCAP log of messages as columns: every number and text of every message, by topic and field.

Messages of ROS 2 are decoded by rosbags, with the definitions (`ros2msg`, `ros2idl`) in the file;
those of JSON say their fields themselves.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.errors import InputError
from taskspec_runner.export.missing import library
from taskspec_runner.record.file_array import blocks
from taskspec_runner.record.folder import parse_json
from taskspec_runner.record.mapped import KeptArrays, gathered
from taskspec_runner.record.whole import open_regular
from taskspec_runner.recorded.sample_texts import SampleTexts, SampleTextsBuilder

Vector = NDArray[np.float64]
#: The fields of a message, as objects with attributes, mappings, lists, numbers and texts.
Decoder = Callable[[bytes], Any]

MAGIC = b"\x89MCAP0\r\n"
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
#: What a message is made of beside messages and nothing.
_SINGLE, _LISTS = (float, int, str), (list, np.ndarray)
#: Messages of a topic that are in memory at a time.
_MESSAGES = 1 << 12


class MessageLog:
    """The columns of an MCAP file, such as `/wrench.wrench.force.z`."""

    timed, form = True, "MCAP"
    lines: Mapping[str, str] = MappingProxyType({})

    def __init__(self, path: Path, topics: Mapping[str, _Topic], units: Mapping[str, str]) -> None:
        """Takes the topics of a file and the units of their fields, by topic and field."""
        self.path, self.units, self._topics = path, units, topics
        self.stated = _metadata(path)

    def _field(self, name: str) -> tuple[_Topic, str]:
        topic = next(t for t in self._topics if name.startswith(f"{t}.") and name in self.units)
        return self._topics[topic], name.removeprefix(f"{topic}.")

    def numbers(self, names: Sequence[str]) -> dict[str, Vector]:
        """(n,) values of fields in all messages of their topics."""
        found = {}
        for name in names:
            topic, field = self._field(name)
            if field in topic.texts:
                raise InputError(f"{self.path}: field '{name}' is not of numbers")
            found[name] = topic.numbers[field].values(np.float64)
        return found

    def words(self, name: str) -> SampleTexts:
        """Values of a field as texts."""
        topic, field = self._field(name)
        if field in topic.texts:
            return topic.texts[field].words(f"{self.path}: field '{name}'")
        builder, values = SampleTextsBuilder(), topic.numbers[field].values(np.float64)
        for part in blocks(len(values)):
            builder.add([f"{value:g}" for value in values[part].tolist()])
        return builder.words(f"{self.path}: field '{name}'")

    def times(self, name: str, stamp: Sequence[str]) -> Vector:
        """(n,) times of its messages, since the first message of the log [s].

        Raises:
            InputError: the messages have no such stamp.
        """
        topic, field = self._field(name)
        if not stamp:
            return topic.times(field, ())
        if len(stamp) == 1:
            # `header.stamp` is its seconds and its nanoseconds, the shorter name first.
            parts = [key for key in topic.numbers if key.startswith(f"{stamp[0]}.")]
            stamp = sorted(parts, key=len)
        if len(stamp) != 2 or any(key not in topic.numbers for key in stamp):
            topic_name = name.removesuffix(f".{field}")
            raise InputError(f"{self.path}: messages of {topic_name} have no stamp of that name")
        return topic.times(field, (stamp[0], stamp[1]))

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

    def __init__(self, decode: Decoder, kept: KeptArrays) -> None:
        self.numbers: dict[str, _Grown] = {}
        self.texts: dict[str, SampleTextsBuilder] = {}
        self._decode, self._kept = decode, kept
        self._stamps = _Grown(kept)
        #: Numbers of the messages that a field is in.
        self._rows: dict[str, _Grown] = {}
        #: Values, and messages that they are in, of fields that are in memory.
        self._waiting: dict[str, tuple[list[Any], list[int]]] = {}
        self._waiting_stamps: list[int] = []
        self.first, self.begin = 0, 0
        self._times: dict[tuple[str, tuple[str, ...]], Vector] = {}

    def add(self, stamp: int, data: bytes) -> None:
        """Takes a message, which raises whatever a damaged one lets the decoder raise."""
        if not self._stamps.count and not self._waiting_stamps:
            self.first = stamp
        row = len(self._waiting_stamps)
        self._waiting_stamps.append(stamp)
        leaves: dict[str, Any] = {}
        _leaves(self._decode(data), "", leaves)
        for name, value in leaves.items():
            values, rows = self._waiting.setdefault(name, ([], []))
            values.append(value)
            rows.append(row)
        if row + 1 == _MESSAGES:
            self.finish()

    def finish(self) -> None:
        """Puts away what waits."""
        before = self._stamps.count
        for name, (values, rows) in self._waiting.items():
            if name in self.texts or (name not in self.numbers and isinstance(values[0], str)):
                self.texts.setdefault(name, SampleTextsBuilder()).add([*map(str, values)])
            else:
                numbers = np.array([*map(_number, values)], dtype=np.float64)
                self.numbers.setdefault(name, _Grown(self._kept)).add(numbers)
            having = np.array(rows, dtype=np.int64) + before
            self._rows.setdefault(name, _Grown(self._kept)).add(having)
        if self._waiting_stamps:
            self._stamps.add(np.array(self._waiting_stamps, dtype=np.int64))
        self._waiting, self._waiting_stamps = {}, []

    @property
    def fields(self) -> Iterator[str]:
        """The fields of all its messages."""
        return iter(self._rows)

    def times(self, name: str, stamp: tuple[str, ...]) -> Vector:
        """(n,) times of the messages with a field [s]; the same array for fields of all of them.

        Args:
            name: of the field.
            stamp: fields of seconds and nanoseconds; empty for when messages were logged.
        """
        every = self._rows[name].count == self._stamps.count
        key = ("" if every else name, stamp)
        if key not in self._times:
            if stamp:
                parts = [self.numbers[each].values(np.int64) for each in stamp]
                stamps = parts[0] * 1_000_000_000 + parts[1]
            else:
                stamps = self._stamps.values(np.int64)
            times = (stamps - self.begin) / 1e9
            self._times[key] = times if every else times[self._rows[name].values(np.int64)]
        return self._times[key]


def _number(value: object) -> float:
    """A number of a message; JSON has no sign for one that is none."""
    if isinstance(value, str):
        return float(value) if value.lower() in ("nan", "inf", "-inf", "infinity") else math.nan
    return float(value)  # type: ignore[arg-type]


def _leaves(value: Any, path: str, into: dict[str, Any]) -> None:
    """Puts the numbers and texts of a message into a mapping, by the way to them.

    That is `wrench.force.z`. Fields of a joint state are there by the names of the joints too, as
    `position[elbow]`: their order is that of whoever sent the message.
    """
    if isinstance(value, _SINGLE):
        into[path] = value
    elif isinstance(value, _LISTS):
        if len(value) <= _LONGEST_LIST:
            parts = value.tolist() if isinstance(value, np.ndarray) else value
            for i, part in enumerate(parts):
                _leaves(part, f"{path}[{i}]", into)
    elif value is not None:
        fields = value if isinstance(value, dict) else vars(value)
        for key, part in fields.items():
            _leaves(part, f"{path}.{key}" if path else key, into)
        if "name" in fields:
            _by_joint(fields, path, into)


def _by_joint(message: Mapping[str, Any], path: str, into: dict[str, Any]) -> None:
    names = message["name"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return
    for field in ("position", "velocity", "effort"):
        values = message.get(field)
        if isinstance(values, list | np.ndarray) and len(values) == len(names):
            head = f"{path}.{field}" if path else field
            into.update((f"{head}[{n}]", float(v)) for n, v in zip(names, values, strict=True))


def _decoder(schema: Any, channel: Any) -> Decoder | None:
    """What takes the messages of a channel apart; None for those of another kind.

    Raises:
        Exception: whatever a damaged definition lets the library raise.
    """
    if channel.message_encoding == "json":
        return json.loads
    if schema is None or schema.encoding not in ("ros2msg", "ros2idl"):
        return None
    typesys = library("rosbags.typesys", "a log of ROS 2", "mcap")
    store, text = typesys.get_typestore(typesys.Stores.EMPTY), schema.data.decode()
    package, _, kind = schema.name.replace("/msg/", "/").partition("/")
    name = f"{package}/msg/{kind}"
    if schema.encoding == "ros2msg":
        store.register(typesys.get_types_from_msg(text, name))
    else:
        known: dict[str, Any] = {}
        for part in re.split(r"^=+\s*^IDL: .*$", text, flags=re.M):
            known |= typesys.get_types_from_idl(part) if part.strip() else {}
        store.register(known)
    return lambda data: store.deserialize_cdr(data, name)


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


def _metadata(path: Path) -> Mapping[str, str]:
    """What an export says of its run; nothing in a file that cannot tell, or of other origin."""
    make_reader = library("mcap.reader", "MCAP", "mcap").make_reader
    # The library lets through whatever its decompressors and unpackers raise.
    with suppress(Exception), open_regular(path) as file:
        for record in make_reader(file, validate_crcs=True).iter_metadata():
            if record.name == "taskspec":
                return dict(record.metadata)
    return {}


def _stated(path: Path, channel: Any) -> Mapping[str, Any]:
    """The units that a channel states."""
    try:
        return parse_json(channel.metadata.get("units", "{}").encode())
    except (RecursionError, ValueError) as error:
        raise InputError(f"cannot read {path}: units of {channel.topic} are no JSON") from error


def read_mcap(path: Path) -> MessageLog:
    """An MCAP file of messages of ROS 2 or JSON; times are those at which they were logged.

    Raises:
        MissingLibraryError: the libraries mcap and rosbags are not installed.
        InputError: it is no such file, cut short, or without a message that can be read.
    """
    topics: dict[str, tuple[Any, Any, _Topic]] = {}
    kept, others = KeptArrays(), set[str]()
    for schema, channel, message in _messages(path):
        topic = channel.topic
        if topic in others:
            continue
        if topic not in topics:
            decode = _decoder_of(path, schema, channel)
            if decode is None:
                others.add(topic)
                continue
            topics[topic] = schema, channel, _Topic(decode, kept)
        _take(path, topics[topic][2], topic, message)
    for _, _, own in topics.values():
        own.finish()
    if not topics:
        hint = f"; it has {', '.join(sorted(others))}" if others else ""
        raise InputError(
            f"cannot read {path}: it holds no message of ROS 2 (ros2msg, ros2idl) or JSON{hint}"
        )
    begin = min(own.first for _, _, own in topics.values())
    units: dict[str, str] = {}
    for topic, (schema, channel, own) in topics.items():
        own.begin = begin
        stated = _stated(path, channel)
        kind = schema.name.replace(".", "/").rpartition("/")[2] if schema is not None else ""
        known = _SI.get(kind, {})
        for name in own.fields:
            usual = (unit for begins, unit in known.items() if name.startswith(begins))
            units[f"{topic}.{name}"] = str(stated.get(name, "")) or next(usual, "")
    return MessageLog(path, {topic: own for topic, (_, _, own) in topics.items()}, units)


def _decoder_of(path: Path, schema: Any, channel: Any) -> Decoder | None:
    try:
        return _decoder(schema, channel)
    except InputError:
        raise
    except Exception as error:
        said = " ".join(str(error).split())[:200]
        raise InputError(
            f"cannot read {path}: {channel.topic} has a damaged definition ({said})"
        ) from error


def _take(path: Path, own: _Topic, topic: str, message: Any) -> None:
    try:
        own.add(message.log_time, message.data)
    except Exception as error:
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(
            f"cannot read {path}: a message of {topic} is cut short or damaged ({said})"
        ) from error
