"""Live params that other programs of this machine set while a run goes on: one datagram each."""

from __future__ import annotations

import contextlib
import hmac
import json
import math
import secrets
import socket
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any
from urllib.parse import urlsplit

from taskspec.program.execution.live_params import LiveParams
from taskspec.spec import Task
from taskspec.text.units import si_unit
from taskspec_runner.errors import InputError
from taskspec_runner.loop.hand import Hand, Hands
from taskspec_runner.loop.live_schedule import LiveMove, read_value, scheduled
from taskspec_runner.record.folder import parse_json

#: What the addresses begin with.
UDP = "udp://"
_FORM = "udp://127.0.0.1:PORT or udp://127.0.0.1:PORT/TOKEN; port 0 is any that is free"
_LOOPBACK = ("127.0.0.1", "localhost")
#: Characters of a token that somebody gives, at least.
_SHORTEST_TOKEN = 16
#: Requests are looked for so often, in run time [s], and so many are taken at once.
_EVERY, _AT_ONCE = 0.01, 64
#: Bytes of a request and of an answer, at most.
LONGEST = 8192


class LiveRequests:
    """Takes requests at a port of this machine, and answers each.

    Whoever does not know the token has no answer.

    Attributes:
        url: where, with the token.
        rejected: datagrams that were no request, or without the token.
    """

    def __init__(self, address: str, task: Task, period: float) -> None:
        """Listens; `address` as `--live` has it, `period` is that of control [s].

        Raises:
            InputError: it is no address of this machine, the port is taken, or the task has no live
                params.
        """
        port, token = _read_address(address)
        if not task.live:
            raise InputError(
                f"--live {address}: the task has no live params; write such as "
                "press: {value: 12 N, live: 5..20 N} in 'params'"
            )
        self._task, self._period = task, period
        self._every = max(round(_EVERY / period), 1)
        self._token = (token or secrets.token_urlsafe(24)).encode()
        self._moves: list[LiveMove] = []
        self.rejected = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        try:
            self._socket.bind((_LOOPBACK[0], port))
        except OSError as error:
            self._socket.close()
            raise InputError(
                f"--live {address}: cannot listen there: {error.strerror or error}; port 0 is any "
                "that is free"
            ) from error
        port = int(self._socket.getsockname()[1])
        self.url = f"{UDP}{_LOOPBACK[0]}:{port}/{self._token.decode()}"

    def close(self) -> None:
        """Gives the port back."""
        self._socket.close()

    def set(self, live: LiveParams, ticks: int) -> int | None:
        """Takes the requests that have come; see `Hand`."""
        for _ in range(_AT_ONCE):
            try:
                data, peer = self._socket.recvfrom(LONGEST + 1)
            except BlockingIOError:
                break
            except OSError:
                # An answer went to somebody who has gone.
                continue
            answer = self._answer(data, live, ticks)
            if answer is None:
                self.rejected += 1
                continue
            with contextlib.suppress(OSError):
                self._socket.sendto(json.dumps(answer).encode(), peer)
        return self._every

    @property
    def lines(self) -> tuple[str, ...]:
        """Those that have been made, as `--live` takes them."""
        return tuple(map(str, self._moves))

    def _answer(self, data: bytes, live: LiveParams, ticks: int) -> dict[str, Any] | None:
        """What a request is answered; None of one that is none, or has another token."""
        try:
            request = dict(parse_json(data)) if len(data) <= LONGEST else {}
        except (ValueError, RecursionError):
            return None
        token = request.get("token")
        if not isinstance(token, str) or not hmac.compare_digest(token.encode(), self._token):
            return None
        wanted = request.get("set", {})
        try:
            if not isinstance(wanted, Mapping):
                raise InputError("'set' is a mapping of params to values")
            # All of them, or none.
            moves = [self._move(str(name), value, ticks) for name, value in wanted.items()]
        except InputError as error:
            return {"error": str(error)}
        for move in moves:
            before = live.target(move.name)
            if live.set(move.name, move.value) != before:
                self._moves.append(move)
        return {"time": ticks * self._period, "params": self._params(live)}

    def _move(self, name: str, value: object, ticks: int) -> LiveMove:
        """A value that a param is to have; the nearest within its bounds."""
        param = self._task.live.get(name)
        if param is None:
            known = ", ".join(self._task.live)
            raise InputError(f"the task has no live param {name[:60]!r}; live are {known}")
        if isinstance(value, str):
            found = read_value(f"{name} = {value}", value, param.dimension, self._task)
        elif isinstance(value, int | float) and not isinstance(value, bool):
            found = float(value)
        else:
            found = math.nan
        if math.isnan(found):
            raise InputError(f"{name!r} is set to a number in SI units, or to a text such as '8 N'")
        within = min(max(found, param.low), param.high)
        return LiveMove(name, within, ticks * self._period, param.dimension)

    def _params(self, live: LiveParams) -> dict[str, dict[str, Any]]:
        return {
            name: {
                "value": float(live[name]),
                "target": float(live.target(name)),
                "low": param.low,
                "high": param.high,
                "unit": si_unit(param.dimension),
            }
            for name, param in self._task.live.items()
        }


@contextlib.contextmanager
def setting(
    live: Sequence[str], task: Task, period: float, say: Callable[[str], None] | None = None
) -> Iterator[Hand | None]:
    """Who sets live params: lines with times, then requests at addresses; None for nobody.

    Args:
        live: the lines and addresses, as `--live` has them.
        task: that has the params.
        period: of control [s].
        say: reports where requests are taken, and which lines came too late.

    Raises:
        InputError: as `read_move` and `LiveRequests`.
    """
    addresses = [line for line in live if line.startswith(UDP)]
    known = scheduled([line for line in live if line not in addresses], task, period)
    hands: list[Hand] = [] if known is None else [known]
    with contextlib.ExitStack() as opened:
        for address in addresses:
            requests = LiveRequests(address, task, period)
            opened.callback(requests.close)
            hands.append(requests)
            if say is not None:
                say(f"live params are set at {requests.url}")
        yield Hands(hands) if hands else None
        if known is not None and say is not None:
            for line in known.left:
                say(f"--live {line!r} was not made: the run was over before")


def _read_address(text: str) -> tuple[int, str]:
    """Port and token of an address; an empty token where it has none.

    Raises:
        InputError: it is none of this machine.
    """
    try:
        parts = urlsplit(text)
        port = parts.port
    except ValueError:
        port = None
    if port is None or parts.scheme != "udp" or parts.query or parts.fragment or parts.username:
        raise InputError(f"--live needs {_FORM}, not {text!r}")
    if parts.hostname not in _LOOPBACK:
        raise InputError(f"--live {text}: requests are taken from this machine alone; {_FORM}")
    token = parts.path.strip("/")
    if token and (len(token) < _SHORTEST_TOKEN or "/" in token or not token.isascii()):
        raise InputError(
            f"--live {text}: a token has {_SHORTEST_TOKEN} or more characters; leave it out, and "
            "one is made"
        )
    return port, token
