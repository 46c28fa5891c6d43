"""The messages between plant and controller, byte by byte: docs/protocol.md has their tables.

All numbers are little-endian. A packet is a head, a body and a CRC-32 of both. What is not whole,
of another version, too long, or has a number that is not finite where it would move a robot, is
rejected with a reason; nothing of it is used.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.spec.servo import COMMANDS, PLURALS, TORQUE
from taskspec.text.characters import escaped
from taskspec_runner.record.folder import parse_json

Vector = NDArray[np.float64]

VERSION = 1
MAGIC = b"TSPK"
#: Kinds of packets.
HELLO, WELCOME, STATE, COMMAND, STOP = 1, 2, 3, 4, 5
#: Bytes of the longest packet.
LONGEST = 16384
#: Bytes of the text of a `STOP`.
LONGEST_TEXT = 400
#: Flags of a `STATE`: where the run starts; it has ended, and nothing is to be answered.
START, LAST = 1, 2

HEAD = struct.Struct("<4sBBHIId")
STATE_BODY = struct.Struct("<HHBBHIId")
COMMAND_BODY = struct.Struct("<HBBI")
CRC = struct.Struct("<I")

#: Fields of each structure, in order: name and what it holds. The tables of the page are these.
HEAD_FIELDS = (
    ("magic", "the four letters `TSPK`"),
    ("version", "1"),
    ("kind", "1 hello, 2 welcome, 3 state, 4 command, 5 stop"),
    ("size", "bytes of the whole packet, checksum included"),
    ("session", "chosen by the plant, sent in its welcome; 0 in a hello"),
    ("number", "of the sample; of a command, that of the sample it answers"),
    ("stamp", "the plant's time of the sample [s]; 0 where there is none"),
)
STATE_FIELDS = (
    ("flags", "1 start: the clock stands, the answer is not applied; 2 last: no answer"),
    ("stage", "number of the file's stage, from 0"),
    ("joints", "n"),
    ("equations", "m"),
    ("extras", "k"),
    ("missed", "samples in a row, up to this one, that were not answered in time"),
    ("visit", "of the stage, from 1; 0 in the start"),
    ("time", "in the stage [s]"),
)
COMMAND_FIELDS = (
    ("quantity", "what the joints are commanded: 0 torques, 1 velocities, 2 positions"),
    ("joints", "n"),
    (
        "grips",
        "1 where the task grips, and a last number is what each jaw presses with [N]; else 0",
    ),
    ("reserved", "0"),
)


class PacketError(Exception):
    """Bytes that are no packet; the message says why."""


@dataclass(frozen=True, slots=True)
class Packet:
    """One message.

    Attributes:
        kind: hello, welcome, state, command or stop.
        session, number, stamp: as in the head.
        body: what is between head and checksum.
    """

    kind: int
    session: int
    number: int
    stamp: float
    body: bytes

    def to_bytes(self) -> bytes:
        """The packet as it is sent."""
        size = HEAD.size + len(self.body) + CRC.size
        head = HEAD.pack(MAGIC, VERSION, self.kind, size, self.session, self.number, self.stamp)
        whole = head + self.body
        return whole + CRC.pack(zlib.crc32(whole))


def read_packet(data: bytes) -> Packet:
    """The packet that some bytes are.

    Raises:
        PacketError: they are none.
    """
    if len(data) < HEAD.size + CRC.size:
        raise PacketError(f"{len(data)} bytes are too few for a packet")
    magic, version, kind, size, session, number, stamp = HEAD.unpack_from(data)
    if magic != MAGIC:
        raise PacketError("it does not begin with TSPK")
    if version != VERSION:
        raise PacketError(f"it is of version {version} of the protocol, this is version {VERSION}")
    if size != len(data) or size > LONGEST:
        raise PacketError(f"it says {size} bytes and has {len(data)}")
    if CRC.unpack_from(data, size - CRC.size)[0] != zlib.crc32(data[: size - CRC.size]):
        raise PacketError("its checksum is wrong")
    if kind not in (HELLO, WELCOME, STATE, COMMAND, STOP):
        raise PacketError(f"there is no kind {kind}")
    if not math.isfinite(stamp):
        raise PacketError("its stamp is not a finite number")
    return Packet(kind, session, number, stamp, data[HEAD.size : size - CRC.size])


# Bodies.


@dataclass(frozen=True, slots=True, eq=False)
class StateBody:
    """The body of a state.

    Attributes:
        flags, stage, missed, visit, time: as in the table.
        q, v: (n,) joint positions and velocities.
        wrench: (6,).
        reactions: (m,).
        extras: (k,) what the hello lists as such.
    """

    flags: int
    stage: int
    missed: int
    visit: int
    time: float
    q: Vector
    v: Vector
    wrench: Vector
    reactions: Vector
    extras: Vector

    def to_bytes(self) -> bytes:
        """The body as bytes."""
        head = STATE_BODY.pack(
            self.flags,
            self.stage,
            len(self.q),
            len(self.reactions),
            len(self.extras),
            min(self.missed, 0xFFFFFFFF),
            self.visit,
            self.time,
        )
        parts = (self.q, self.v, self.wrench, self.reactions, self.extras)
        return head + np.concatenate(parts).astype("<f8").tobytes()


def read_state(body: bytes) -> StateBody:
    """A state.

    Raises:
        PacketError: it is none.
    """
    if len(body) < STATE_BODY.size:
        raise PacketError("a state is longer")
    flags, stage, n, m, k, missed, visit, time = STATE_BODY.unpack_from(body)
    counts = (n, n, 6, m, k)
    if len(body) != STATE_BODY.size + 8 * sum(counts):
        raise PacketError(f"a state of {n} joints, {m} equations and {k} extras has another size")
    values = np.frombuffer(body, "<f8", offset=STATE_BODY.size).astype(float)
    if not np.isfinite(values[: 2 * n + 6 + m]).all() or not math.isfinite(time):
        raise PacketError("a state has numbers that are not finite")
    q, v, wrench, reactions, extras = np.split(values, np.cumsum(counts)[:-1])
    return StateBody(flags, stage, missed, visit, time, q, v, wrench, reactions, extras)


def command_body(command: Vector, quantity: str = TORQUE, *, grips: bool = False) -> bytes:
    """The body of a command: torques, velocities or positions of the joints (n,).

    Where it grips, a last number is what each jaw is to press with [N].
    """
    joints = len(command) - grips
    head = COMMAND_BODY.pack(COMMANDS.index(quantity), joints, int(grips), 0)
    return head + np.asarray(command).astype("<f8").tobytes()


class QuantityError(PacketError):
    """A command of another quantity than the joints take."""


def read_command(
    body: bytes, joints: int, quantity: str = TORQUE, *, grips: bool = False
) -> Vector:
    """What a command has for so many joints (n,), in the unit of its quantity.

    Where it `grips`, (n + 1,), and the last one is what each jaw is to press with [N].

    Raises:
        PacketError: it is none, or its numbers are not finite.
        QuantityError: it is of another quantity.
    """
    size = COMMAND_BODY.size + 8 * (joints + grips)
    if len(body) != size or (body[2], body[3]) != (joints, grips):
        jaws = " and a gripper" if grips else ""
        raise PacketError(f"a command for {joints} joints{jaws} has {size} bytes")
    number = COMMAND_BODY.unpack_from(body)[0]
    if number != COMMANDS.index(quantity):
        known = number < len(COMMANDS)
        sent = f"joint {PLURALS[COMMANDS[number]]}" if known else f"quantity {number}"
        raise QuantityError(f"the arm takes joint {PLURALS[quantity]}, and the command has {sent}")
    command = np.frombuffer(body, "<f8", offset=COMMAND_BODY.size).astype(float)
    if not np.isfinite(command).all():
        raise PacketError(f"a {quantity} is not a finite number")
    return command


def json_body(content: Mapping[str, Any]) -> bytes:
    """The body of a hello or a welcome."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode()


def read_json_body(body: bytes) -> dict[str, Any]:
    """Reads the body of a hello or a welcome.

    Raises:
        PacketError: it is no JSON object.
    """
    try:
        said = parse_json(body)
    except (ValueError, RecursionError) as error:
        raise PacketError(f"it holds no JSON ({escaped(str(error))})") from error
    if not said and body.strip()[:1] != b"{":
        raise PacketError("it holds no JSON object")
    return dict(said)


def stop_body(text: str) -> bytes:
    """The body of a stop: why."""
    return text.encode()[:LONGEST_TEXT]


def read_stop(body: bytes) -> str:
    """Why somebody stops, in one line that can be printed."""
    text = body[:LONGEST_TEXT].decode("utf-8", "replace").strip()
    return escaped(text) or "no reason was given"
