"""Packets: what is written is read, what is not whole is rejected, and the page has every byte."""

from __future__ import annotations

import random
import re
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from meeting import ROOT, TOUCH, program_of, shipped, spoilt

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_task
from taskspec_runner.link import packets
from taskspec_runner.link.packets import Packet, PacketError, StateBody
from taskspec_runner.link.server import ServerOptions, welcome

PAGE = ROOT / "docs" / "protocol.md"
SIZES = {"s": "bytes", "B": "u8", "H": "u16", "I": "u32", "d": "f64"}


def state(n: int = 7, m: int = 2, k: int = 60) -> StateBody:
    numbers = np.random.Generator(np.random.PCG64(1)).standard_normal(2 * n + 6 + m + k)
    parts = np.split(numbers, np.cumsum([n, n, 6, m]))
    return StateBody(0, 1, 3, 2, 0.25, *parts)


@given(st.integers(1, 16), st.integers(0, 5), st.integers(0, 300), st.integers(0, 0xFFFFFFFF))
@settings(max_examples=40, deadline=None)
def test_state_is_read_as_it_was_written(n: int, m: int, k: int, number: int) -> None:
    sent = state(n, m, k)
    found = packets.read_packet(Packet(packets.STATE, 9, number, 1.5, sent.to_bytes()).to_bytes())
    assert (found.kind, found.session, found.number, found.stamp) == (packets.STATE, 9, number, 1.5)
    read = packets.read_state(found.body)
    for name in ("q", "v", "wrench", "reactions", "extras"):
        assert np.array_equal(getattr(read, name), getattr(sent, name))
    assert (read.flags, read.stage, read.missed, read.visit, read.time) == (0, 1, 3, 2, 0.25)


def test_command_is_read_as_it_was_written() -> None:
    torque = np.array([1.0, -2.5, 1e-300])
    assert np.array_equal(packets.read_command(packets.command_body(torque), 3), torque)
    with pytest.raises(PacketError, match="4 joints"):
        packets.read_command(packets.command_body(torque), 4)
    for wrong in (np.nan, np.inf):
        with pytest.raises(PacketError, match="finite"):
            packets.read_command(packets.command_body(np.array([wrong])), 1)


@given(st.binary(max_size=600))
@settings(max_examples=200, deadline=None)
def test_bytes_by_chance_are_rejected(data: bytes) -> None:
    with pytest.raises(PacketError):
        packets.read_packet(data)


def test_what_is_spoilt_is_rejected_or_the_same() -> None:
    whole, dice = Packet(packets.STATE, 1, 2, 0.0, state().to_bytes()).to_bytes(), random.Random(3)
    for _ in range(3000):
        data = spoilt(whole, dice)
        if data == whole:
            continue
        with pytest.raises(PacketError):
            packets.read_packet(data)


@given(st.binary(max_size=400))
@settings(max_examples=200, deadline=None)
def test_bodies_of_right_packets_are_not_believed(body: bytes) -> None:
    """Whoever knows the checksum may still send anything."""
    for read in (packets.read_state, packets.read_json_body, lambda b: packets.read_command(b, 7)):
        try:
            read(body)
        except PacketError:
            continue
    assert packets.read_stop(body).isprintable()


def test_another_version_is_named() -> None:
    data = bytearray(Packet(packets.HELLO, 0, 0, 0.0, b"{}").to_bytes())
    data[4] = 2
    with pytest.raises(PacketError, match="version 2 of the protocol, this is version 1"):
        packets.read_packet(bytes(data))


# The page.


def layout(
    structure: struct.Struct, fields: tuple[tuple[str, str], ...], at: int
) -> list[list[str]]:
    """The rows of a table: first byte, type, name."""
    rows = []
    codes = re.findall(r"\d*[a-zA-Z]", structure.format)
    for code, (name, _) in zip(codes, fields, strict=True):
        size = struct.calcsize("<" + code)
        kind = f"{size} bytes" if code.endswith("s") else SIZES[code]
        rows.append([str(at), kind, name])
        at += size
    return rows


@pytest.mark.parametrize(
    ("name", "structure", "fields", "at"),
    [
        ("head", packets.HEAD, packets.HEAD_FIELDS, 0),
        ("state", packets.STATE_BODY, packets.STATE_FIELDS, packets.HEAD.size),
        ("command", packets.COMMAND_BODY, packets.COMMAND_FIELDS, packets.HEAD.size),
    ],
)
def test_page_has_every_byte(
    name: str, structure: struct.Struct, fields: tuple[tuple[str, str], ...], at: int
) -> None:
    text = PAGE.read_text(encoding="utf-8").split(f"<!-- bytes: {name} -->")[1].split("\n\n")[0]
    rows = [
        [cell.strip().strip("`") for cell in line.split("|")[1:-1]] for line in text.splitlines()
    ]
    shown = [row[:3] for row in rows if row and row[0].isdigit()]
    expected = layout(structure, fields, at)
    assert shown[: len(expected)] == expected
    meanings = [row[3] for row in rows if row and row[0].isdigit()][: len(expected)]
    assert [m.replace("`", "") for m in meanings] == [m.replace("`", "") for _, m in fields]
    # What follows is numbers: it begins where the fixed part ends.
    if len(shown) > len(expected):
        assert shown[len(expected)][0] == str(at + structure.size)


def test_page_has_constants_and_extras() -> None:
    text = " ".join(PAGE.read_text(encoding="utf-8").split())
    assert f"at most {packets.LONGEST} bytes" in text
    assert f"at most {packets.LONGEST_TEXT} bytes" in text
    said = welcome(program_of(TOUCH), ServerOptions())
    names = re.findall(r"^\| `(\w+)` \| [\d n]+ \|", PAGE.read_text(encoding="utf-8"), re.M)
    assert names == [name for name, _ in said["extras"]]


def test_welcome_of_every_arm_fits() -> None:
    for name in ("touch", "press-qp", "screw", "ring"):
        program = (
            program_of(TOUCH) if name == "touch" else compile_unchecked(load_task(shipped(name)))
        )
        said = welcome(program, ServerOptions())
        assert len(packets.json_body(said)) < packets.LONGEST / 4
        assert len(said["robot"]["joints"]) == len(said["robot"]["units"]["torque"])
