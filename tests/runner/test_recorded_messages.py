"""MCAP logs by columns, held against what rosbags reads of each message."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from taskspec_runner.errors import InputError
from taskspec_runner.recorded.messages import read_mcap

_RULE = "\n" + 80 * "=" + "\n"
DEFINITION = _RULE.join((
    "bool on\nstring label\nfloat64 x\nint8 a\nuint16[3] b\nfloat32[] values\nstring[] words\n"
    "pkg/Part part\npkg/Part[] parts\nuint64 last\nuint8[] picture\nint32[<=4] few\n",
    "MSG: pkg/Part\nstring[] name\nfloat64[] position\nfloat64[] effort\nint16 z\n",
))  # fmt: skip
KIND = "pkg/msg/Whole"


def _store() -> Any:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(DEFINITION, KIND))
    return store


def _drawn(store: Any, random: np.random.Generator) -> Any:
    """A message whose texts and lists have any lengths; of some the lengths agree by chance."""

    def words(count: int) -> list[str]:
        return ["".join(random.choice([*"abé"], random.integers(0, 3))) for _ in range(count)]

    def part() -> Any:
        count = int(random.integers(0, 3))
        names = [f"j{i}" for i in random.permutation(3)[:count]]
        return store.types["pkg/msg/Part"](
            name=names, position=random.random(count), effort=random.random(count // 2),
            z=int(random.integers(-9, 9)),
        )  # fmt: skip

    return store.types[KIND](
        on=bool(random.integers(2)), label=words(1)[0], x=float(random.standard_normal()),
        a=int(random.integers(-9, 9)), b=random.integers(0, 9, 3).astype(np.uint16),
        values=random.random(random.integers(0, 3)).astype(np.float32),
        words=words(int(random.integers(0, 3))), part=part(),
        parts=[part() for _ in range(random.integers(0, 3))], last=int(random.integers(1 << 50)),
        picture=np.zeros(random.choice([0, 3, 70]), dtype=np.uint8),
        few=random.integers(0, 9, random.integers(0, 4)).astype(np.int32),
    )  # fmt: skip


def _leaves(value: Any, path: str, into: dict[str, Any]) -> None:
    """Every number and text of a message of rosbags; joints by their names too."""
    if isinstance(value, bool | int | float | str | np.generic):
        into[path] = value if isinstance(value, str) else float(value)
    elif isinstance(value, list | np.ndarray):
        for i, each in enumerate(value if len(value) <= 64 else ()):
            _leaves(each, f"{path}[{i}]", into)
    else:
        for name, each in vars(value).items():
            if name != "__msgtype__":
                _leaves(each, f"{path}.{name}" if path else name, into)
        for field in ("position", "effort") if hasattr(value, "name") else ():
            if len(getattr(value, field)) == len(value.name):
                names = zip(value.name, getattr(value, field), strict=True)
                into.update((f"{path}.{field}[{name}]", float(x)) for name, x in names)


#: Ways of writing a file; and whether times rise.
WRITTEN = {
    "indexed": ({}, True),
    "small chunks": ({"chunk_size": 900}, True),
    "without an index": ({"index_types": IndexType.CHUNK}, True),
    "without chunks": ({"use_chunking": False}, True),
    "lz4": ({"compression": CompressionType.LZ4}, True),
    "plain": ({"compression": CompressionType.NONE, "enable_data_crcs": True}, True),
    "out of order": ({"chunk_size": 900}, False),
}


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("way", WRITTEN)
def test_columns_are_what_rosbags_reads_of_each_message(
    way: str, tmp_path: Path, big: bool
) -> None:
    options, rising = WRITTEN[way]
    store, random, path = _store(), np.random.default_rng(5), tmp_path / "log.mcap"
    numbers: dict[str, list[float]] = defaultdict(list)
    words: dict[str, list[str]] = defaultdict(list)
    times: dict[str, list[int]] = defaultdict(list)
    messages = [_drawn(store, random) for _ in range(400)]
    stamps = np.arange(400) if rising else random.integers(0, 90, 400)
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start("ros2")
        schema = writer.register_schema(KIND, "ros2msg", DEFINITION.encode())
        # Two senders on one topic, and one whose messages stand between.
        channels = [writer.register_channel(topic, "cdr", schema) for topic in ("/a", "/a", "/b")]
        for i, message in enumerate(messages):
            data = bytes(store.serialize_cdr(message, KIND, little_endian=not big))
            writer.add_message(channels[i % 2], int(stamps[i]), data, 0)
            writer.add_message(channels[2], int(stamps[i]), data, 0)
        writer.finish()
    for i in np.argsort(stamps, kind="stable").tolist():
        leaves: dict[str, Any] = {}
        _leaves(messages[i], "", leaves)
        for name, value in leaves.items():
            (words if isinstance(value, str) else numbers)[name].append(value)
            times[name].append(int(stamps[i]))
    assert len(numbers) > 30
    assert len(words) > 8
    log = read_mcap(path)
    for topic in ("/a", "/b"):
        assert {n for n in log.units if n.startswith(topic)} == {f"{topic}.{n}" for n in times}
        found = log.numbers([f"{topic}.{name}" for name in numbers])
        for name, values in numbers.items():
            np.testing.assert_array_equal(found[f"{topic}.{name}"], values, err_msg=name)
        for name, texts in words.items():
            read = log.words(f"{topic}.{name}")
            assert [read.names[code] for code in read.codes.astype(int)] == texts, name
        for name in ("x", "part.position[j1]"):
            since = (np.array(times[name]) - stamps.min()) / 1e9
            np.testing.assert_array_equal(log.times(f"{topic}.{name}", ()), since)


def _small(path: Path) -> bytes:
    store, random = _store(), np.random.default_rng(1)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, enable_data_crcs=True)
        writer.start("ros2")
        schema = writer.register_schema(KIND, "ros2msg", DEFINITION.encode())
        channel = writer.register_channel("/a", "cdr", schema)
        for i in range(6):
            data = bytes(store.serialize_cdr(_drawn(store, random), KIND))
            writer.add_message(channel, i, data, i)
        writer.finish()
    return path.read_bytes()


def test_every_flipped_bit_is_found(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    content = _small(path)
    read_mcap(path)
    assert len(content) > 2000
    for at in range(0, len(content), 3):
        spoiled = bytearray(content)
        spoiled[at] ^= 1 << at % 8
        path.write_bytes(spoiled)
        with pytest.raises(InputError, match=r"cannot read"):
            read_mcap(path)


def test_every_cut_is_found(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    content = _small(path)
    for length in range(0, len(content), 7):
        path.write_bytes(content[:length])
        with pytest.raises(InputError, match="it is no whole MCAP file"):
            read_mcap(path)


@pytest.mark.parametrize("data", [b"", b"\0\1\0\0", b"\0\1\0\0\1", b"\0\1\0\0" + b"\xff" * 64])
def test_messages_that_do_not_fit_their_definition(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2")
        schema = writer.register_schema(KIND, "ros2msg", DEFINITION.encode())
        writer.add_message(writer.register_channel("/a", "cdr", schema), 0, data, 0)
        writer.finish()
    with pytest.raises(InputError, match="a message of /a is cut short or damaged"):
        read_mcap(path)
