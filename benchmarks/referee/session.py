"""A controller's side of `taskspec plant`, for any law: examples/plant/client.py in parts.

It knows the protocol (docs/protocol.md) and nothing of taskspec.
"""

from __future__ import annotations

import json
import socket
import struct
import sys
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

HELLO, WELCOME, STATE, COMMAND, STOP = 1, 2, 3, 4, 5
_HEAD, _BODY = struct.Struct("<4sBBHIId"), struct.Struct("<HHBBHIId")
_ROOM = 16384
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

    @property
    def frame(self) -> Vector:
        """(6, 6) from the axes of the stage's frame to those of the world, of a twist or wrench."""
        R = self.extras["frame"].reshape(3, 3).T
        return np.block([[R, np.zeros((3, 3))], [np.zeros((3, 3)), R]])

    @property
    def on_force(self) -> NDArray[np.bool_]:
        """(6,) axes that have a set point of force."""
        return np.isfinite(self.extras["force_ref"])

    @property
    def feed(self) -> Vector:
        """(6,) the force that is commanded, 0 where none is."""
        return np.nan_to_num(self.extras["force_ref"])

    @property
    def off(self) -> Vector:
        """(6,) reference less position in the frame's axes, 0 where nothing is commanded."""
        return np.nan_to_num(self.extras["position_ref"] - self.extras["position"])

    @property
    def off_rate(self) -> Vector:
        """(6,) the same of velocities; an axis without a reference is to rest."""
        rate = np.nan_to_num(self.extras["velocity_ref"])
        return rate - np.nan_to_num(self.extras["velocity"])


class Law(Protocol):
    """A controller that referees."""

    def torque(self, sample: Sample) -> Vector:
        """(n,) joint torques, gravity included."""
        ...


class Session:
    """One plant that is driven from hello to stop."""

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
        ends = np.cumsum([length for _, length in self.told["extras"]])[:-1]
        names = [name for name, _ in self.told["extras"]]
        newest, answer = -1, b""
        while True:
            kind, _, number, body = _read(self._link.recv(_ROOM))
            if kind == STOP:
                self._link.close()
                return body.decode()
            if kind != STATE:
                continue
            if number > newest:
                _, _, n, m, _, _, visit, time = _BODY.unpack_from(body)
                values = np.frombuffer(body, "<f8", offset=_BODY.size)
                parts = np.split(values[2 * n + 6 + m :], ends)
                extras = dict(zip(names, parts, strict=True))
                sample = Sample(visit, time, values[:n], values[n : 2 * n], extras)
                torque = np.asarray(law.torque(sample), dtype=float)
                newest, answer = number, struct.pack("<HBBI", 0, n, 0, 0) + torque.tobytes()
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
