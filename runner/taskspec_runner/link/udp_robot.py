"""A robot at the other end of a UDP socket: the controller's side of docs/protocol.md."""

from __future__ import annotations

import math
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec import __version__
from taskspec.spec.servo import COMMANDS, POSITION, TORQUE
from taskspec.text.characters import escaped
from taskspec_runner.errors import InputError, LinkError
from taskspec_runner.link import packets
from taskspec_runner.link.address import Endpoint, read_endpoint
from taskspec_runner.link.packets import Packet, PacketError
from taskspec_runner.link.robot import (
    CONTACT,
    READING,
    TARGET,
    RobotFacts,
    RobotLimits,
    Sample,
)
from taskspec_runner.link.waiting import received

Vector = NDArray[np.float64]

#: From one hello to the next [s].
_AGAIN = 0.2
#: How long a plant that says nothing is waited for, at the start and then [s].
PATIENCE, SILENCE = 10.0, 2.0
#: A stop is said so many times, as one may be lost.
_STOPS = 3
_MOST_JOINTS = 64


class UdpRobot:
    """A robot, or a `taskspec plant`, that speaks the protocol.

    Attributes:
        where: its address.
        welcome: all that it says of itself.
        facts, limits: the same as a robot has them.
        rejected, resent: packets that were none, and answers that were sent again.
    """

    facts: RobotFacts
    limits: RobotLimits

    def __init__(
        self,
        url: str,
        *,
        patience: float = PATIENCE,
        silence: float = SILENCE,
        say: Callable[[str], None] | None = None,
    ) -> None:
        """Says hello, and waits for the welcome.

        Args:
            url: where it is.
            patience: how long it is waited for [s].
            silence: after which it is given up in a run [s].
            say: reports now and then that it is still waited for.

        Raises:
            InputError: there is none, or it speaks another version.
        """
        endpoint = read_endpoint(url, "--on")
        self.where, self._silence = endpoint.text, silence
        self.rejected = self.resent = 0
        self._session, self._number, self._started = 0, -1, False
        self._answer = b""
        self._socket = _connected(endpoint)
        try:
            self.welcome = self._introduced(patience, say)
            self.facts, self.limits = _facts(self.welcome, self.where)
            self._at_rest = np.zeros(len(self.facts.joints))
            self._named, self._targets = _params(self.welcome, self.where)
        except BaseException:
            self._socket.close()
            raise

    def _introduced(self, patience: float, say: Callable[[str], None] | None) -> dict[str, Any]:
        body = packets.json_body({"protocol": packets.VERSION, "client": f"taskspec {__version__}"})
        hello = Packet(packets.HELLO, 0, 0, 0.0, body).to_bytes()
        began, reported, last = time.monotonic(), 0, "nothing came back"
        while (waited := time.monotonic() - began) < patience:
            if say is not None and int(waited) > reported:
                reported = int(waited)
                say(f"waiting for {self.where}: {reported} s of {patience:.0f} s")
            try:
                self._socket.send(hello)
                until = time.monotonic() + _AGAIN
                while (data := self._received(until)) is not None:
                    packet = packets.read_packet(data)
                    if packet.kind == packets.STOP:
                        why = packets.read_stop(packet.body)
                        raise InputError(f"the plant at {self.where} takes no controller: {why}")
                    if packet.kind == packets.WELCOME:
                        self._session = packet.session
                        return packets.read_json_body(packet.body)
            except PacketError as error:
                if "of version" in str(error):
                    raise InputError(
                        f"cannot talk to {self.where}: {error}; install the same version of "
                        "taskspec at both ends"
                    ) from error
                last = f"what came back is no packet: {error}"
            except ConnectionRefusedError:
                last = "nothing listens there"
                time.sleep(_AGAIN)
            except OSError as error:
                last = error.strerror or str(error)
                time.sleep(_AGAIN)
        raise InputError(
            f"no plant answers at {self.where} in {patience:g} s ({last}); start one with "
            f"'taskspec plant FILE --listen {self.where}', or name where it listens"
        )

    def _received(self, until: float) -> bytes | None:
        """The next packet; None if none comes until a time of `time.monotonic` [s]."""
        found = received(self._socket, until - time.monotonic())
        return None if found is None else found[0]

    def read(self) -> Sample:
        """Waits for the next sample; in lock-step, one that comes again is answered again.

        Raises:
            LinkError: the plant has stopped, or says nothing for too long.
        """
        if self._number == 0 and not self._started:
            self._started = True
            self._send_answer(self._at_rest)
        until = time.monotonic() + self._silence
        while True:
            try:
                data = self._received(until)
                if data is None:
                    text = f"no sample from {self.where} for {self._silence:g} s"
                    raise LinkError("connection_lost", f"{text}; is the plant still running?")
                packet = packets.read_packet(data)
                if packet.session != self._session:
                    raise PacketError("it is of another session")
                if packet.kind == packets.STOP:
                    text = packets.read_stop(packet.body)
                    raise LinkError("robot_stopped", f"the robot at {self.where} ended: {text}")
                if packet.kind != packets.STATE:
                    continue
                sample = self._sample(packet)
            except PacketError:
                self.rejected += 1
                # A flood of rubbish is no reason to wait for ever.
                if time.monotonic() > until:
                    text = f"no sample from {self.where} for {self._silence:g} s, only rubbish"
                    raise LinkError("connection_lost", text) from None
            except OSError as error:
                text = f"nothing listens at {self.where} any more: {error.strerror or error}"
                raise LinkError("connection_lost", text) from error
            else:
                if sample is not None:
                    return sample

    def _sample(self, packet: Packet) -> Sample | None:
        """The sample of a state; None of one that has been answered."""
        state = packets.read_state(packet.body)
        n, m = len(self.facts.joints), len(self.facts.reactions)
        if len(state.q) != n or len(state.reactions) != m:
            raise PacketError(f"it is not of {n} joints and {m} equations")
        start = bool(state.flags & packets.START)
        old = packet.number <= self._number and self._number >= 0
        # Of a clock that goes on, whoever reads decides what an old sample is.
        if (start and old) or (self.facts.lock_step and old):
            if packet.number == self._number and self._answer:
                self.resent += 1
                self._socket.send(self._answer)
            return None
        if not start:
            self._started = True
        elif self.facts.command == POSITION:
            self._at_rest = state.q
        self._number, self._answer = packet.number, b""
        last = bool(state.flags & packets.LAST)
        return Sample(
            *(state.q, state.v, state.wrench, packet.stamp, state.reactions, last),
            self._params(state.extras),
        )

    def _params(self, extras: Vector) -> Mapping[str, float]:
        """What live params are set to over there; none of a robot that does not say it."""
        if not self._named:
            return {}
        values = extras[self._targets : self._targets + len(self._named)].tolist()
        return {name: x for name, x in zip(self._named, values, strict=False) if math.isfinite(x)}

    def write(self, command: Vector) -> None:
        """Answers the last sample with what the joints are commanded (n,), as `facts` have it.

        Raises:
            LinkError: it cannot be sent.
        """
        self._send_answer(command)

    def _send_answer(self, command: Vector) -> None:
        body = packets.command_body(command, self.facts.command, grips=self.facts.grips)
        packet = Packet(packets.COMMAND, self._session, self._number, 0.0, body)
        self._answer = packet.to_bytes()
        try:
            self._socket.send(self._answer)
        except BlockingIOError:
            pass
        except OSError as error:
            text = f"commands do not get through to {self.where}: {error.strerror or error}"
            raise LinkError("connection_lost", text) from error

    def stop(self, reason: str) -> None:
        """Says that nothing follows; the robot brings itself to rest."""
        if self._socket.fileno() < 0:
            return
        body = packets.stop_body(reason)
        packet = Packet(packets.STOP, self._session, max(self._number, 0), 0.0, body).to_bytes()
        for _ in range(_STOPS):
            try:
                self._socket.send(packet)
            except OSError:
                break
        self._socket.close()


def _connected(endpoint: Endpoint) -> socket.socket:
    try:
        found = socket.getaddrinfo(endpoint.host, endpoint.port, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"{endpoint.text} cannot be reached: host {endpoint.host!r} has no address ({why}); "
            "check the name, or write the number of the address"
        ) from error
    family, kind, protocol, _, target = found[0]
    made = socket.socket(family, kind, protocol)
    try:
        made.setblocking(False)
        made.connect(target)
    except OSError as error:
        made.close()
        raise InputError(
            f"{endpoint.text} cannot be reached: {error.strerror or error}; check the network, "
            "and that the address is right"
        ) from error
    return made


def _facts(said: Mapping[str, Any], where: str) -> tuple[RobotFacts, RobotLimits]:
    """The robot's facts in a welcome.

    Raises:
        InputError: it does not say it.
    """
    try:
        robot, limits = said["robot"], said["robot"]["limits"]
        joints = tuple(escaped(str(name)) for name in robot["joints"])
        period = float(said["period"])
        wrench, mode = str(said["wrench"]), str(said["mode"])
        facts = RobotFacts(
            escaped(str(robot["name"])),
            joints,
            period,
            wrench,
            tuple(escaped(str(name)) for name in said["equations"]),
            mode == "lock-step",
            str(robot.get("command", TORQUE)),
        )
        parts = [_numbers(limits[name]) for name in ("torque", "velocity", "lower", "upper")]
        good = 0 < len(joints) <= _MOST_JOINTS and period > 0 and math.isfinite(period)
        good = good and facts.command in COMMANDS
        good = good and wrench in (CONTACT, READING) and mode in ("lock-step", "free-running")
        if not good or any(len(part) != len(joints) for part in parts):
            raise ValueError("its numbers do not fit each other")
    except (LookupError, TypeError, ValueError, ArithmeticError) as error:
        raise InputError(
            f"the welcome of {where} is not what version {packets.VERSION} of the protocol "
            f"requires: {escaped(repr(error))[:200]}; see docs/protocol.md"
        ) from error
    return facts, RobotLimits(*parts)


def _params(said: Mapping[str, Any], where: str) -> tuple[tuple[str, ...], int]:
    """The live params that a plant says the targets of, and where these are among its extras.

    Raises:
        InputError: it says it wrongly.
    """
    try:
        names, place = tuple(str(name) for name in said.get("params", ())), 0
        for name, length in said.get("extras", ()) if names else ():
            if name == TARGET and length == len(names):
                return names, place
            place += int(length)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the welcome of {where} has extras or params that are none: "
            f"{escaped(repr(error))[:200]}; see docs/protocol.md"
        ) from error
    return (), 0


def _numbers(values: Sequence[float | None]) -> tuple[float, ...]:
    return tuple(math.inf if value is None else float(value) for value in values)
