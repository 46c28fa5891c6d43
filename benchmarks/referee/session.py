"""A controller's side of `taskspec plant`, for any law: examples/plant/client.py in parts.

It knows the protocol (docs/protocol.md) and nothing of taskspec.
"""

from __future__ import annotations

import json
import socket
import struct
import sys
import time
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

HELLO, WELCOME, STATE, COMMAND, STOP = 1, 2, 3, 4, 5
_HEAD, _BODY = struct.Struct("<4sBBHIId"), struct.Struct("<HHBBHIId")
_ROOM = 16384
#: What joints may take, as a command's first number has it.
QUANTITIES = ("torque", "velocity", "position")
#: Seconds after which a hello is sent again, and in which the plant has to go on.
_AGAIN, _PATIENCE = 0.2, 60.0


@dataclass(frozen=True)
class Sample:
    """What the plant tells in a tick.

    Attributes:
        visit: of a stage, counted from 1; 0 before the first tick.
        time: in the stage [s].
        q, v: (n,) joints.
        extras: what else it tells, by name; see docs/protocol.md.
    """

    visit: int
    time: float
    q: Vector
    v: Vector
    extras: Mapping[str, Vector]

    @property
    def jacobian(self) -> Vector:
        """(6, n) of the tip, world axes."""
        return self.extras["jacobian"].reshape(-1, 6).T

    @cached_property
    def frame(self) -> Vector:
        """(6, 6) from the axes of the stage's frame to those of the world, of a twist or wrench."""
        T = np.zeros((6, 6))
        T[:3, :3] = T[3:, 3:] = self.extras["frame"].reshape(3, 3).T
        return T

    @property
    def on_force(self) -> NDArray[np.bool_]:
        """(6,) axes that have a set point of force."""
        return np.isfinite(self.extras["force_ref"])

    @property
    def feed(self) -> Vector:
        """(6,) the force that is commanded, 0 where none is."""
        return _filled(self.extras["force_ref"])

    @property
    def force(self) -> Vector:
        """(6,) that the robot applies, as measured, in the frame's axes [N, N m]."""
        return self.extras["force"]

    @property
    def tip(self) -> tuple[Vector, Vector]:
        """(3, 3) axes and (3,) place of the tip in the world [m]."""
        return self.extras["tip_rotation"].reshape(3, 3).T, self.extras["tip"]

    @property
    def rate(self) -> Vector:
        """(6,) velocities of the references in the frame's axes, 0 where there is none."""
        return _filled(self.extras["velocity_ref"])

    @property
    def off(self) -> Vector:
        """(6,) reference less position in the frame's axes, 0 where nothing is commanded."""
        return _filled(self.extras["position_ref"] - self.extras["position"])

    @property
    def off_rate(self) -> Vector:
        """(6,) the same of velocities; an axis without a reference is to rest."""
        return self.rate - _filled(self.extras["velocity"])


def _filled(values: Vector) -> Vector:
    """With 0 for what is not there."""
    return np.where(np.isnan(values), 0.0, values)


class Law(Protocol):
    """A controller that referees."""

    def command(self, sample: Sample) -> Vector:
        """(n,) what the arm's joints take.

        Torques with gravity [N m, N], velocities [rad/s, m/s] or positions [rad, m].
        """
        ...


class Answers:
    """What a law answers to the samples of a plant.

    Attributes:
        taken: processor time of each answer [s].
    """

    def __init__(self, law: Law, told: Mapping[str, Any]) -> None:
        """Of a law, to a plant with that welcome."""
        self.taken: list[float] = []
        self._law, self._names = law, [name for name, _ in told["extras"]]
        self._ends = np.cumsum([length for _, length in told["extras"]])[:-1]
        self._quantity = QUANTITIES.index(told["robot"].get("command", QUANTITIES[0]))

    def to(self, state: bytes) -> bytes:
        """The body of the command that answers the body of a state."""
        _, _, n, m, _, _, visit, at = _BODY.unpack_from(state)
        values = np.frombuffer(state, "<f8", offset=_BODY.size)
        parts = np.split(values[2 * n + 6 + m :], self._ends)
        extras = dict(zip(self._names, parts, strict=True))
        sample = Sample(visit, at, values[:n], values[n : 2 * n], extras)
        began = time.thread_time()
        given = np.asarray(self._law.command(sample), dtype=float)
        self.taken.append(time.thread_time() - began)
        return struct.pack("<HBBI", self._quantity, n, 0, 0) + given.tobytes()


class Session:
    """One plant that is driven from hello to stop.

    Attributes:
        told: the plant's welcome.
    """

    def __init__(self, port: int, name: str) -> None:
        """Says hello until it is answered.

        Args:
            port: of this machine.
            name: that the plant writes into its summary.
        """
        self._link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._link.connect(("127.0.0.1", port))
        self._link.settimeout(_AGAIN)
        kind, self._session, body = 0, 0, b""
        while kind != WELCOME:
            try:
                self._link.send(_packet(HELLO, 0, 0, json.dumps({"client": name}).encode()))
                kind, self._session, _, body = _read(self._link.recv(_ROOM))
            except (TimeoutError, ConnectionRefusedError):
                continue
        self.told: dict[str, Any] = json.loads(body)
        self._link.settimeout(_PATIENCE)

    def drive(self, law: Law) -> str:
        """Answers every sample by a law; what the plant says at its end."""
        answers, newest, answer = Answers(law, self.told), -1, b""
        while True:
            kind, _, number, body = _read(self._link.recv(_ROOM))
            if kind == STOP:
                self._link.close()
                return body.decode()
            if kind != STATE:
                continue
            if number > newest:
                newest, answer = number, answers.to(body)
            self._link.send(_packet(COMMAND, self._session, number, answer))


def _packet(kind: int, session: int, number: int, body: bytes) -> bytes:
    size = _HEAD.size + len(body) + 4
    data = _HEAD.pack(b"TSPK", 1, kind, size, session, number, 0.0) + body
    return data + struct.pack("<I", zlib.crc32(data))


def _read(data: bytes) -> tuple[int, int, int, bytes]:
    magic, version, kind, size, session, number, _ = _HEAD.unpack_from(data)
    good = magic == b"TSPK" and version == 1 and size == len(data)
    good = good and zlib.crc32(data[:-4]) == struct.unpack("<I", data[-4:])[0]
    return (kind, session, number, data[_HEAD.size : -4]) if good else (0, 0, 0, b"")


if sys.byteorder != "little":
    sys.exit("this client is written for processors whose numbers begin with the low byte")
