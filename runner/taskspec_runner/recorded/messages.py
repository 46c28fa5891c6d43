"""An MCAP log of messages as columns: every number and text of every message, by topic and field.

Messages of ROS 2 are decoded by the definitions (`ros2msg`, `ros2idl`) in the file, which rosbags
parses; those of JSON say their fields themselves.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property, partial
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from taskspec.missing import library
from taskspec.regular_file import open_regular
from taskspec_runner.errors import InputError
from taskspec_runner.record.file_array import blocks
from taskspec_runner.record.folder import parse_json
from taskspec_runner.record.mapped import KeptArrays, gathered
from taskspec_runner.recorded.cdr_layouts import LONGEST_LIST, CdrMessages
from taskspec_runner.recorded.mcap_chunks import ChannelMessages, ChunkReader
from taskspec_runner.recorded.sample_texts import SampleTexts, SampleTextsBuilder

Vector = NDArray[np.float64]
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
#: Messages of a topic that are in memory at a time.
_MESSAGES = 1 << 14


class MessageLog:
    """The columns of an MCAP file, such as `/wrench.wrench.force.z`."""

    timed, form = True, "MCAP"
    lines: Mapping[str, str] = MappingProxyType({})

    def __init__(
        self,
        path: Path,
        topics: Mapping[str, _Topic],
        units: Mapping[str, str],
        columns: Mapping[str, str],
    ) -> None:
        """Takes the topics of a file.

        Args:
            path: of the file.
            topics: by their names.
            units: of their fields, by topic and field.
            columns: see `LogSource`.
        """
        self.path, self.units, self.columns, self._topics = path, units, columns, topics
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
            found[name] = topic.values(field)
        return found

    def words(self, name: str) -> SampleTexts:
        """Values of a field as texts."""
        topic, field = self._field(name)
        if field in topic.texts:
            found = topic.texts[field].words(f"{self.path}: field '{name}'")
            order = topic.order(field)
            return found if order is None else found.ordered(order)
        builder, values = SampleTextsBuilder(), topic.values(field)
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

    def count_on(self, first: int, after: int) -> None:
        """Takes whole numbers that follow each other."""
        self._parts.append(partial(np.arange, first, after))
        self.count += after - first

    def values(self, dtype: Any) -> NDArray[Any]:
        return gathered((part() for part in self._parts), self.count, np.dtype(dtype))


class _Topic:
    """The messages of one topic, some at a time.

    Attributes:
        numbers: fields to their values, in the order of the file.
        texts: fields to their words.
        first: least time stamp of a message [ns].
        begin: time stamp from which times count [ns].
    """

    def __init__(self, kept: KeptArrays) -> None:
        self.numbers: dict[str, _Grown] = {}
        self.texts: dict[str, SampleTextsBuilder] = {}
        self._kept = kept
        self._stamps = _Grown(kept)
        #: Numbers of the messages that a field is in.
        self._rows: dict[str, _Grown] = {}
        #: Messages, and values in them or codes of texts, of fields that are in memory.
        self._waiting: dict[str, list[tuple[NDArray[np.int64], Vector]]] = {}
        self._waiting_stamps: list[NDArray[np.int64]] = []
        self._new = 0
        self.first, self.begin = 0, 0
        self._times: dict[tuple[str, tuple[str, ...]], Vector] = {}

    def add(self, found: ChannelMessages, decode: Decoder) -> None:
        """Takes messages; raises whatever a damaged one lets the decoder raise."""
        first = int(found.times.min())
        self.first = min(self.first, first) if self._stamps.count or self._new else first
        for rows, fields in decode(found):
            since = rows + self._new
            for name, values in fields:
                self._waiting.setdefault(name, []).append((since, values))
        self._waiting_stamps.append(found.times)
        self._new += len(found.times)
        if self._new >= _MESSAGES:
            self.finish()

    def finish(self) -> None:
        """Puts away what waits."""
        before, new = self._stamps.count, self._new
        #: Fields of messages that are laid out alike are in the same messages.
        known = dict[tuple[int, ...], tuple[NDArray[np.int64], NDArray[np.int64] | None]]()
        for name, parts in self._waiting.items():
            key = tuple(id(rows) for rows, _ in parts)
            if key not in known:
                rows = np.concatenate([rows for rows, _ in parts])
                order = None if (np.diff(rows) > 0).all() else np.argsort(rows)
                known[key] = rows if order is None else rows[order], order
            rows, order = known[key]
            self._keep(name, [values for _, values in parts], order)
            having = self._rows.setdefault(name, _Grown(self._kept))
            if len(rows) == new:
                having.count_on(before, before + new)
            else:
                having.add(rows + before)
        if new:
            self._stamps.add(np.concatenate(self._waiting_stamps))
        self._waiting, self._waiting_stamps, self._new = {}, [], 0

    def _keep(self, name: str, parts: Sequence[Any], order: NDArray[np.int64] | None) -> None:
        """Puts away the values of a field, which come in the order of their messages if sorted."""
        if name in self.texts or (name not in self.numbers and isinstance(parts[0], MessageTexts)):
            known = [
                each if isinstance(each, MessageTexts) else MessageTexts.of(each.tolist())
                for each in parts
            ]
            texts = list(dict.fromkeys(text for each in known for text in each.texts))
            place = {text: code for code, text in enumerate(texts)}
            codes = [np.array([place[t] for t in each.texts])[each.codes] for each in known]
            whole = np.concatenate(codes)
            builder = self.texts.setdefault(name, SampleTextsBuilder())
            builder.add_coded(texts, whole if order is None else whole[order])
            return
        numbers = [each.numbers() if isinstance(each, MessageTexts) else each for each in parts]
        values = np.concatenate(numbers)
        made = self.numbers.setdefault(name, _Grown(self._kept))
        made.add(values if order is None else values[order])

    @property
    def fields(self) -> Iterator[str]:
        """The fields of all its messages."""
        return iter(self._rows)

    @cached_property
    def _ranks(self) -> NDArray[np.int64] | None:
        """(n,) the place of each message by its time; None where they are in the order of time."""
        stamps = self._stamps.values(np.int64)
        if (np.diff(stamps) >= 0).all():
            return None
        return np.argsort(np.argsort(stamps, kind="stable"), kind="stable")

    def order(self, name: str) -> NDArray[np.int64] | None:
        """(n,) the messages with a field in the order of time; None if they are in it."""
        if self._ranks is None:
            return None
        return np.argsort(self._ranks[self._rows[name].values(np.int64)])

    def values(self, name: str) -> Vector:
        """(n,) the numbers of a field in the order of time."""
        found, order = self.numbers[name].values(np.float64), self.order(name)
        return found if order is None else found[order]

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
            if not every:
                times = times[self._rows[name].values(np.int64)]
            order = self.order(name)
            self._times[key] = times if order is None else times[order]
        return self._times[key]


class MessageTexts(NamedTuple):
    """Texts of messages: each once, and which each message has (n,)."""

    texts: Sequence[str]
    codes: NDArray[np.int64]

    @staticmethod
    def of(texts: Sequence[object]) -> MessageTexts:
        """The texts of messages, one each."""
        known = dict.fromkeys(map(str, texts))
        place = {text: code for code, text in enumerate(known)}
        return MessageTexts(
            [*known], np.array([place[str(text)] for text in texts], dtype=np.int64)
        )

    def numbers(self) -> Vector:
        """(n,) Numbers that JSON has no sign for; not a number where it is another text."""
        return np.array([_number(text) for text in self.texts])[self.codes]


def _number(text: str) -> float:
    known = ("nan", "inf", "-inf", "infinity")
    return float(text) if text.lower() in known else math.nan


#: Messages, and their fields: the name of each, and its values in these or its texts.
Fields = Iterator[tuple[NDArray[np.int64], Iterator[tuple[str, Any]]]]
Decoder = Callable[[ChannelMessages], Fields]


def _cdr(messages: CdrMessages) -> Decoder:
    """What takes messages in CDR apart."""

    def decode(found: ChannelMessages) -> Fields:
        for rows, content, layout in messages.split(found):
            words = (
                (name, MessageTexts(texts, codes)) for name, texts, codes in layout.words(content)
            )
            yield rows, chain(layout.columns(content), words)

    return decode


def _json(found: ChannelMessages) -> Fields:
    """The fields of messages in JSON."""
    numbers = dict[str, tuple[list[int], list[float]]]()
    texts = dict[str, tuple[list[int], list[str]]]()
    for row, (start, end) in enumerate(
        zip(found.starts.tolist(), found.ends.tolist(), strict=True)
    ):
        leaves = dict[str, Any]()
        _leaves(json.loads(found.content[start:end]), "", leaves)
        for name, value in leaves.items():
            into: Any = texts if isinstance(value, str) else numbers
            rows, values = into.setdefault(name, ([], []))
            rows.append(row)
            values.append(value)
    for name, (rows, values) in numbers.items():
        yield np.array(rows), iter([(name, np.array(values, dtype=np.float64))])
    for name, (rows, words) in texts.items():
        yield np.array(rows), iter([(name, MessageTexts.of(words))])


def _leaves(value: Any, path: str, into: dict[str, Any]) -> None:
    """Puts the numbers and texts of a message into a mapping, by the way to them.

    That is `wrench.force.z`. Fields of a joint state are there by the names of the joints too, as
    `position[elbow]`: their order is that of whoever sent the message.
    """
    if isinstance(value, float | int | str):
        into[path] = value
    elif isinstance(value, list):
        if len(value) <= LONGEST_LIST:
            for i, part in enumerate(value):
                _leaves(part, f"{path}[{i}]", into)
    elif value is not None:
        for key, part in value.items():
            _leaves(part, f"{path}.{key}" if path else key, into)
        if "name" in value:
            _by_joint(value, path, into)


def _by_joint(message: Mapping[str, Any], path: str, into: dict[str, Any]) -> None:
    names = message["name"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return
    for field in ("position", "velocity", "effort"):
        values = message.get(field)
        if isinstance(values, list) and len(values) == len(names):
            head = f"{path}.{field}" if path else field
            into.update((f"{head}[{n}]", float(v)) for n, v in zip(names, values, strict=True))


def _decoder(schema: Any, channel: Any) -> Decoder | None:
    """What takes the messages of a channel apart; None for those of another kind.

    Raises:
        Exception: whatever a damaged definition lets the library raise.
    """
    if channel.message_encoding == "json":
        return _json
    if schema is None or schema.encoding not in ("ros2msg", "ros2idl"):
        return None
    typesys = library("rosbags.typesys", "a log of ROS 2")
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
    return _cdr(CdrMessages(store.fielddefs, name))


def _messages(path: Path) -> Iterator[ChannelMessages]:
    """The messages of each channel in each chunk of a file.

    Raises:
        InputError: it is no whole MCAP file.
    """
    library("mcap.records", "MCAP")
    try:
        with open_regular(path) as file:
            yield from ChunkReader(file)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except InputError:
        raise
    except Exception as error:
        # The library lets through whatever its decompressors and unpackers raise.
        said = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"cannot read {path}: it is no whole MCAP file ({said})") from error


def _metadata(path: Path) -> Mapping[str, str]:
    """What an export says of its run; nothing in a file that cannot tell, or of other origin."""
    make_reader = library("mcap.reader", "MCAP").make_reader
    # The library lets through whatever its decompressors and unpackers raise.
    with suppress(Exception), open_regular(path) as file:
        for record in make_reader(file, validate_crcs=True).iter_metadata():
            if record.name == "taskspec":
                return dict(record.metadata)
    return {}


def _stated(path: Path, channel: Any, what: str) -> Mapping[str, Any]:
    """What a channel states of its fields: their units, or the columns that they were."""
    try:
        return parse_json(channel.metadata.get(what, "{}").encode())
    except (RecursionError, ValueError) as error:
        raise InputError(f"cannot read {path}: {what} of {channel.topic} are no JSON") from error


def read_mcap(path: Path) -> MessageLog:
    """An MCAP file of messages of ROS 2 or JSON; times are those at which they were logged.

    Raises:
        MissingLibraryError: the libraries mcap and rosbags are not installed.
        InputError: it is no such file, cut short, or without a message that can be read.
    """
    topics: dict[str, tuple[Any, Any, _Topic]] = {}
    decoders: dict[int, Decoder | None] = {}
    kept, others = KeptArrays(), set[str]()
    for found in _messages(path):
        channel, schema = found.channel, found.schema
        if channel.id not in decoders:
            decoders[channel.id] = _decoder_of(path, schema, channel)
        decode = decoders[channel.id]
        if decode is None:
            others.add(channel.topic)
            continue
        if channel.topic not in topics:
            topics[channel.topic] = schema, channel, _Topic(kept)
        try:
            topics[channel.topic][2].add(found, decode)
        except Exception as error:
            said = " ".join(str(error).split())[:200] or type(error).__name__
            raise InputError(
                f"cannot read {path}: a message of {channel.topic} is cut short or damaged ({said})"
            ) from error
    for _, _, own in topics.values():
        own.finish()
    if not topics:
        hint = f"; it has {', '.join(sorted(others))}" if others else ""
        raise InputError(
            f"cannot read {path}: it holds no message of ROS 2 (ros2msg, ros2idl) or JSON{hint}"
        )
    begin = min(own.first for _, _, own in topics.values())
    units, columns = dict[str, str](), dict[str, str]()
    for topic, (schema, channel, own) in topics.items():
        own.begin = begin
        stated = _stated(path, channel, "units")
        kind = schema.name.replace(".", "/").rpartition("/")[2] if schema is not None else ""
        known = _SI.get(kind, {})
        for name in own.fields:
            usual = (unit for begins, unit in known.items() if name.startswith(begins))
            units[f"{topic}.{name}"] = str(stated.get(name, "")) or next(usual, "")
        for field, column in _stated(path, channel, "columns").items():
            if f"{topic}.{field}" in units:
                columns[str(column)] = f"{topic}.{field}"
    return MessageLog(path, {topic: own for topic, (_, _, own) in topics.items()}, units, columns)


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
