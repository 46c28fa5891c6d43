"""Signals of a run as it goes on, as JSON by UDP: what PlotJuggler's UDP server shows."""

from __future__ import annotations

import json
import math
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import field
from typing import Any
from urllib.parse import parse_qs, urlsplit
from warnings import warn

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import InputError
from taskspec_runner.record.nested import path_of

#: Messages in a second of simulated time, unless the address says otherwise.
RATE = 100.0
#: A name that has no address after this time has none [s].
_PATIENCE = 2.0
_FORM = "udp://HOST:PORT, such as udp://127.0.0.1:9870"


@dataclass(frozen=True, slots=True)
class Address:
    """Destination of telemetry. `rate` is in messages a second of simulated time [Hz]."""

    host: str
    port: int
    rate: float = RATE


def read_address(text: str) -> Address:
    """An address `udp://HOST:PORT`, optionally with `?rate=HZ`.

    Raises:
        InputError: it is none.
    """
    wrong = InputError(f"--telemetry needs {_FORM}, not {text!r}")
    try:
        parts = urlsplit(text)
        query = parse_qs(parts.query, keep_blank_values=True, strict_parsing=bool(parts.query))
        rate = float(query.pop("rate", [str(RATE)])[-1])
        port = parts.port
    except ValueError as error:
        raise wrong from error
    if parts.scheme != "udp" or not parts.hostname or not port or parts.path.strip("/") or query:
        raise wrong
    if not (math.isfinite(rate) and rate > 0):
        raise InputError(f"--telemetry needs a positive rate, such as ?rate=100, not {text!r}")
    return Address(parts.hostname, port, rate)


@dataclass(slots=True)
class Telemetry:
    """Sends messages and never waits; what cannot be sent is left out.

    Attributes:
        address: where to.
        trouble: the first thing that went wrong, empty if nothing did.
        sent: number of messages.
    """

    address: Address
    trouble: str = ""
    sent: int = 0
    _socket: socket.socket | None = field(default=None, repr=False)
    _target: Any = field(default=None, repr=False)

    def __post_init__(self) -> None:
        found: list[Any] = []
        # A name server that does not answer must not keep the run waiting.
        asking = threading.Thread(target=self._resolve, args=(found,), daemon=True)
        asking.start()
        asking.join(_PATIENCE)
        if not found:
            self._warn(f"{self.address.host} has no address")
        elif isinstance(found[0], OSError):
            self._warn(found[0].strerror or str(found[0]))
        else:
            self._open(found[0])

    def send(self, columns: Mapping[str, float | str]) -> None:
        """Sends the values of one tick by column name, if that can be done at once."""
        if self._socket is None:
            return
        try:
            self._socket.sendto(message(columns), self._target)
            self.sent += 1
        except BlockingIOError:
            pass
        except OSError as error:
            self._warn(error.strerror or str(error))

    def close(self) -> None:
        """Gives the socket back."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _resolve(self, found: list[Any]) -> None:
        try:
            found.append(
                socket.getaddrinfo(self.address.host, self.address.port, type=socket.SOCK_DGRAM)[0]
            )
        except (OSError, UnicodeError) as error:
            found.append(error if isinstance(error, OSError) else OSError(str(error)))

    def _open(self, info: Any) -> None:
        family, kind, protocol, _, self._target = info
        try:
            self._socket = socket.socket(family, kind, protocol)
            self._socket.setblocking(False)
        except OSError as error:
            self._warn(error.strerror or str(error))

    def _warn(self, reason: str) -> None:
        if not self.trouble:
            to = f"{self.address.host}:{self.address.port}"
            self.trouble = f"telemetry to {to} does not get through: {reason}"


@contextmanager
def sending(address: str | None, say: Callable[[str], None] = warn) -> Iterator[Telemetry | None]:
    """Telemetry for the time of a run, or none; that it does not get through is said once.

    Args:
        address: where to, None for none.
        say: reports what goes wrong.

    Raises:
        InputError: the address is none.
    """
    if address is None:
        yield None
        return
    telemetry = Telemetry(read_address(address))
    said = telemetry.trouble
    try:
        if said:
            say(said)
        yield telemetry
    finally:
        telemetry.close()
        if telemetry.trouble != said:
            say(telemetry.trouble)


def message(columns: Mapping[str, float | str]) -> bytes:
    """One tick as a JSON object: nested by the dots of names, `timestamp` beside them.

    What has no value is left out, as JSON has no number for it.
    """
    packet: dict[str, Any] = {"timestamp": columns["clock"]}
    for name, value in columns.items():
        if name == "clock" or (isinstance(value, float) and not math.isfinite(value)):
            continue
        *groups, leaf = path_of(name)
        inner = packet
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[leaf] = value
    return json.dumps(packet, separators=(",", ":"), allow_nan=False).encode()
