"""The task's plant as a server: whoever answers its samples drives the arm.

The file's own machine runs beside: it says which stage it is and what is commanded, ends stages by
the file's guards, and stops at its limits. Its commands are not applied; those of the answers are.
"""

from __future__ import annotations

import contextlib
import copy
import math
import secrets
import socket
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec import __version__
from taskspec.control.stopping import slowed
from taskspec.deferred_methods import dataclass
from taskspec.program.ports import fields
from taskspec.program.program import Program
from taskspec.program.worlds import World
from taskspec.spec import Robot
from taskspec.spec.servo import TORQUE
from taskspec.text.characters import escaped
from taskspec.text.units import FORCE, LENGTH, VELOCITY, si_unit
from taskspec_runner.errors import InputError, LinkError
from taskspec_runner.link import packets
from taskspec_runner.link.address import Endpoint
from taskspec_runner.link.packets import Packet, PacketError, QuantityError, StateBody
from taskspec_runner.link.robot import TARGET, RobotFacts, RobotLimits
from taskspec_runner.link.waiting import received
from taskspec_runner.loop.assembly import Assembly, assemble
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.plant.plant import Plant

Vector = NDArray[np.float64]
Peer = tuple[Any, ...]

#: In lock-step a sample that is not answered is sent again after this time [s].
_AGAIN = 0.05
#: How long the end is reported to a controller that does not answer [s].
_FAREWELL = 0.3
#: Samples in a row that may go without an answer at the wall clock.
STOP_AFTER = 20
#: How long a controller is waited for at first, and an answer in lock-step [s].
WAIT, ANSWER = 600.0, 2.0
#: Who may have said hello before one of them commands.
_MOST_CANDIDATES = 8
#: How long the answer to the start may take [s].
_READY = 30.0
#: What a state has beside what is measured: of the arm's model, then of the machine's outputs.
_MODEL = ("gravity", "jacobian")
_OUTPUTS = (
    *("tip", "tip_rotation", "offset", "frame"),
    *("position", "position_ref", "velocity", "velocity_ref", "force", "force_ref"),
)


@dataclass(frozen=True, slots=True)
class ServerOptions:
    """Options of a served plant.

    Attributes:
        free_running: at the wall clock; else in lock-step.
        stop_after: at the wall clock, so many samples in a row may go without an answer.
        wait: for a controller [s].
        answer: in lock-step, how long an answer is waited for [s].
    """

    free_running: bool = False
    stop_after: int = STOP_AFTER
    wait: float = WAIT
    answer: float = ANSWER


class PlantServer:
    """The socket of a plant, and the one controller that drives it.

    Attributes:
        endpoint: where it listens.
        client: what the controller calls itself.
        rejected: packets that were none, or of another session.
    """

    def __init__(self, endpoint: Endpoint) -> None:
        """Listens.

        Raises:
            InputError: it cannot.
        """
        try:
            found = socket.getaddrinfo(
                endpoint.host, endpoint.port, type=socket.SOCK_DGRAM, flags=socket.AI_PASSIVE
            )
            family, kind, protocol, _, address = found[0]
            self._socket = socket.socket(family, kind, protocol)
        except (OSError, UnicodeError) as error:
            why = getattr(error, "strerror", None) or str(error)
            raise InputError(
                f"cannot listen at {endpoint.text}: {why}; name an address of this machine, such "
                "as udp://127.0.0.1:39017"
            ) from error
        try:
            self._socket.setblocking(False)
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise InputError(
                f"cannot listen at {endpoint.text}: {error.strerror or error}; choose another "
                "port, or port 0 for any that is free"
            ) from error
        self.endpoint = Endpoint(endpoint.host, int(self._socket.getsockname()[1]))
        self.client, self.rejected = "", 0
        #: Who drives it, once a command has come; who has said hello before, with what they are.
        self._peer: Peer | None = None
        self._candidates: dict[Peer, tuple[str, float]] = {}
        self._until = 0.0
        self._say: Callable[[str], None] = _unsaid
        self._session, self._welcome = 0, b""
        self._takes, self._joints = TORQUE, 0

    def close(self) -> None:
        """Gives the socket back."""
        self._socket.close()

    @property
    def client_came(self) -> bool:
        """Whether a controller has commanded something."""
        return self._peer is not None

    @property
    def closed(self) -> bool:
        """Whether it listens no more."""
        return self._socket.fileno() < 0

    def wait(
        self, welcome: dict[str, Any], patience: float, say: Callable[[str], None] | None = None
    ) -> None:
        """Waits for a controller, and welcomes it.

        Args:
            welcome: what it is sent.
            patience: how long [s].
            say: reports now and then that nobody has come.

        Raises:
            InputError: nobody has come.
        """
        self._session = secrets.randbelow(0xFFFFFFFE) + 1
        self._takes, self._joints = welcome["robot"]["command"], len(welcome["robot"]["joints"])
        self._grips = welcome.get("grips", False)
        body = packets.json_body(welcome)
        self._welcome = Packet(packets.WELCOME, self._session, 0, 0.0, body).to_bytes()
        if len(self._welcome) > packets.LONGEST:
            raise InputError("the task has too many names for a welcome of 16384 bytes")
        self._until, self._say = time.monotonic() + patience, say or _unsaid
        if not self.wait_again():
            raise InputError(
                f"no controller has said hello at {self.endpoint.text} in {patience:g} s; start "
                f"one, such as 'taskspec run FILE --on {self.endpoint.text}', or wait longer with "
                "--wait"
            )

    def wait_again(self) -> bool:
        """Waits for a hello, also after one that no command followed, and welcomes its sender.

        Returns:
            Whether there was one before the patience of `wait` was over.
        """
        fresh = time.monotonic() - _READY / 2
        self._candidates = {p: each for p, each in self._candidates.items() if each[1] > fresh}
        if self._candidates:
            return True
        began, reported = time.monotonic(), 0.0
        while time.monotonic() < self._until:
            waited = time.monotonic() - began
            if waited >= reported + 5:
                reported = waited
                self._say(f"waiting for a controller at {self.endpoint.text}: {waited:.0f} s")
            data, peer = self._received(0.2)
            if data is None:
                continue
            try:
                packet = packets.read_packet(data)
                if packet.kind != packets.HELLO:
                    raise PacketError("it is no hello")
                said = packets.read_json_body(packet.body)
            except PacketError as error:
                self.rejected += 1
                if "of version" in str(error):
                    # No longer than what came: its sender may be another than it says.
                    self._refuse(peer, str(error), len(data) - packets.HEAD.size - packets.CRC.size)
                continue
            self._welcomed(peer, said)
            return True
        return False

    def _welcomed(self, peer: Peer, hello: Mapping[str, Any]) -> None:
        """Welcomes who says hello before anybody commands: the first command decides who drives."""
        if len(self._candidates) < _MOST_CANDIDATES or peer in self._candidates:
            self._candidates[peer] = _line(hello.get("client")), time.monotonic()
            self._send(self._welcome, peer)

    def receive(self, until: float) -> Packet | None:
        """The controller's next command; None if none comes until a time [s, monotonic].

        Raises:
            LinkError: the controller stops.
        """
        late = False
        while not late:
            data, peer = self._received(until - time.monotonic())
            if data is None:
                return None
            # A flood of rubbish is read no longer than that.
            late = time.monotonic() > until
            try:
                packet = packets.read_packet(data)
                if self._peer is None and not self._chosen(packet, peer):
                    continue
                if peer != self._peer:
                    if packet.kind == packets.HELLO:
                        self._refuse(peer, f"{self.client or 'another controller'} drives it")
                    raise PacketError("it is of somebody else")
                if packet.kind == packets.HELLO:
                    # Its welcome was lost.
                    self._send(self._welcome)
                    continue
                if packet.session != self._session:
                    raise PacketError("it is of another session")
                if packet.kind == packets.STOP:
                    text = packets.read_stop(packet.body)
                    raise LinkError("controller_stopped", f"the controller ended the run: {text}")
                if packet.kind == packets.COMMAND:
                    return packet
                raise PacketError("a controller sends hello, command or stop")
            except PacketError:
                self.rejected += 1
        return None

    def _chosen(self, packet: Packet, peer: Peer) -> bool:
        """Whether a packet is the first command of one who has said hello, who drives from then on.

        Raises:
            PacketError: it is of somebody else, or nothing that one may send before.
        """
        if packet.kind == packets.HELLO:
            self._welcomed(peer, packets.read_json_body(packet.body))
            return False
        if peer not in self._candidates or packet.session != self._session:
            raise PacketError("it is of another session")
        if packet.kind == packets.STOP:
            del self._candidates[peer]
            return False
        if packet.kind != packets.COMMAND:
            raise PacketError("a controller sends hello, command or stop")
        try:
            self.commanded(packet)
        except QuantityError as error:
            self._refuse(peer, str(error))
            del self._candidates[peer]
            raise
        self._peer, self.client = peer, self._candidates[peer][0]
        for other in self._candidates:
            if other != peer:
                self._refuse(other, f"{self.client or 'another controller'} drives it")
        return True

    def commanded(self, packet: Packet) -> Vector:
        """What the joints are commanded (n,) by a packet, last the gripper of a task that grips.

        Raises:
            PacketError: it is no command for them.
        """
        return packets.read_command(packet.body, self._joints, self._takes, grips=self._grips)

    def send(self, number: int, stamp: float, state: StateBody) -> None:
        """Sends a state."""
        body = state.to_bytes()
        self._send(Packet(packets.STATE, self._session, number, stamp, body).to_bytes())

    def say_stop(self, text: str) -> None:
        """Reports to the controller that nothing follows."""
        body = packets.stop_body(text)
        self._send(Packet(packets.STOP, self._session, 0, 0.0, body).to_bytes())

    def _refuse(self, peer: Peer, why: str, most: int = packets.LONGEST_TEXT) -> None:
        """Tells somebody why not; in `most` bytes, which is what a sender's address is good for."""
        body = packets.stop_body(why)[:most]
        # Who has been welcomed takes no stop of another session.
        session = self._session if peer in self._candidates else 0
        self._send(Packet(packets.STOP, session, 0, 0.0, body).to_bytes(), peer)

    def _send(self, data: bytes, peer: Peer | None = None) -> None:
        """Sends to one, or to who drives; as long as nobody does, to all who have said hello."""
        own = self._candidates if self._peer is None else (self._peer,)
        for to in own if peer is None else (peer,):
            # What cannot be sent is as lost as what the network loses: silence is given up in time.
            with contextlib.suppress(OSError):
                self._socket.sendto(data, to)

    def _received(self, wait: float) -> tuple[bytes | None, Peer]:
        try:
            return received(self._socket, wait) or (None, ())
        except OSError:
            # What was sent to somebody who has gone.
            return None, ()


def _line(text: object) -> str:
    return escaped(text[:60]) if isinstance(text, str) else ""


def _unsaid(_: str) -> None:
    """What is reported to nobody."""


class ServedPlant:
    """The plant of the loop where a remote controller commands the joints.

    In lock-step a sample is sent until it is answered. At the wall clock an answer counts that is
    there when the period is over; without one the last command is held, a velocity only for as
    many samples as are borne by default: then it falls to zero. Where this process itself comes too
    late, the plant's clock waits for it.

    Attributes:
        arm: itself, whose divergence the loop checks.
        diverged: as the plant's arm.
        lost, in_a_row, late, repeated, clipped: answers so far, by what became of them.
        slipped: how long the plant's clock has waited [s].
    """

    def __init__(
        self, server: PlantServer, parts: Assembly[Plant], sensing: Sensing, options: ServerOptions
    ) -> None:
        self._plant, self._sensing, self._machine = parts.plant, sensing, parts.machine
        self._server, self._options, self._bus = server, options, parts.bus
        drives = parts.program.context.drives
        # A servo goes to a position as fast as its limits let it.
        self._most = np.inf if drives.positions else drives.most
        self._velocities = drives.commands == "velocity"
        self._period = parts.program.context.period
        self.diverged = False
        self.lost = self.in_a_row = self.late = self.repeated = self.clipped = 0
        self.slipped = 0.0
        self._missed, self._newest, self._ticks = 0, 0, 0
        self._started = False
        self._last: StateBody | None = None
        self._command = np.zeros(len(self._machine.torque))
        self._step = self._period * drives.rates
        self._due, self._late_now = math.nan, 0.0
        terms, outputs = self._machine.terms, slices_of(parts)
        model = {"gravity": terms.gravity, "jacobian": terms.arrays[3]}
        views = [model[name] for name in _MODEL] + [outputs[name] for name in _OUTPUTS]
        named = [*zip((*_MODEL, *_OUTPUTS), views, strict=True)]
        if live := self._machine.live:
            table = live.table
            named += [("param", np.asarray(table.values)), (TARGET, np.asarray(table.targets))]
        self.extras = tuple(named)

    @property
    def arm(self) -> ServedPlant:
        """The arm, as the loop uses it."""
        return self

    def read(self) -> None:
        """Senses; the first time, the controller is given where the run starts."""
        self._sensing.read()
        if not self._started:
            self._started = True
            self._command[:] = self._machine.at_rest()
            # The controller may compile its part before it answers.
            patience = max(_READY, self._options.answer)
            while True:
                try:
                    self._in_lock_step(0, self._state(packets.START), patience)
                    break
                except LinkError as error:
                    # Who has said hello and commanded nothing keeps nobody else from driving.
                    if self._server.client_came or not self._server.wait_again():
                        error.ticks = 0
                        raise
            self._due = time.monotonic()

    def step(self, command: Vector) -> None:
        """Sends the sample, and holds what it is answered with for one control period.

        Raises:
            LinkError: the controller is gone.
        """
        number = self._ticks + 1
        try:
            if self._options.free_running:
                self._at_the_wall_clock(number)
            else:
                state, patience = self._state(0), self._options.answer
                self._hold(self._in_lock_step(number, state, patience))
        except LinkError as error:
            error.ticks = self._ticks
            raise
        command[:] = self._command
        self._machine.predict()
        if self._bus.linked:
            self._bus.view("link")[:] = self._late_now, self._missed
        self._plant.step(command)
        self.diverged = self._plant.arm.diverged
        self._ticks += 1

    def release(self) -> Plant:
        """The plant without its controller; what that is sent at last is the sample before it."""
        self._last = copy.deepcopy(self._state(packets.LAST))
        return self._plant

    def alarm(self) -> tuple[str, str] | None:
        """The alarm of the simulator; None without one."""
        return self._plant.alarm()

    def _state(self, flags: int) -> StateBody:
        machine = self._machine
        wrench = machine.wrench if machine.sensor is None else machine.sensor.reading
        start = flags & packets.START
        return StateBody(
            flags,
            machine.index,
            self._missed,
            0 if start else machine.visits[machine.stage.name],
            machine.t,
            machine.q,
            machine.v,
            wrench,
            machine.reactions,
            np.concatenate([view for _, view in self.extras]),
        )

    def _in_lock_step(self, number: int, state: StateBody, patience: float) -> Vector:
        """The answer to a sample, which is sent until there is one, or `patience` [s] is over."""
        until, stamp = time.monotonic() + patience, self._ticks * self._period
        while True:
            self._server.send(number, stamp, state)
            again = time.monotonic() + _AGAIN
            while (packet := self._server.receive(again)) is not None:
                command = self._answer(packet)
                if packet.number == number and command is not None:
                    return command
                self.repeated += command is not None
                if time.monotonic() > until:
                    break
            if time.monotonic() > until:
                text = f"no answer from the controller for {patience:g} s"
                raise LinkError("connection_lost", text)

    def _answer(self, packet: Packet) -> Vector | None:
        try:
            return self._server.commanded(packet)
        except PacketError:
            self._server.rejected += 1
            return None

    def _at_the_wall_clock(self, number: int) -> None:
        """Sends a sample, and takes the newest answer when its period is over."""
        now = time.monotonic()
        # Behind by more than a period: rather the clock waits than ticks without a chance.
        if now > self._due + self._period:
            self.slipped += now - self._due
            self._due = now
        self._due += self._period
        self._server.send(number, self._ticks * self._period, self._state(0))
        found: Vector | None = None
        while (packet := self._server.receive(self._due)) is not None:
            command = self._answer(packet)
            if command is not None and self._newest < packet.number <= number:
                found, self._newest = command, packet.number
            else:
                self.repeated += command is not None
            if time.monotonic() > self._due + self._period:
                break
        self._late_now = max(time.monotonic() - self._due, 0.0)
        self._missed = number - self._newest
        if self._missed:
            self.lost += 1
            self.in_a_row = max(self.in_a_row, self._missed)
            self.late += found is not None
        if found is not None:
            self._hold(found)
        elif self._velocities and self._missed > STOP_AFTER:
            self._command[:] = slowed(self._command, self._step)
        if self._missed > self._options.stop_after:
            raise LinkError(
                "answers_lost",
                f"{self._missed} samples in a row went without an answer; up to "
                f"{self._options.stop_after} are borne (--stop-after)",
            )

    def _hold(self, command: Vector) -> None:
        """Takes what the joints are commanded (n,), within what they can do, and the gripper."""
        n = len(self._command)
        if len(command) > n:
            np.asarray(self._machine.grip.command)[:] = np.maximum(command[n:], 0.0)
        np.clip(command[:n], -self._most, self._most, out=self._command)
        self.clipped += not np.array_equal(command[:n], self._command)

    def farewell(self, text: str) -> None:
        """Gives the controller the sample that ended the run, and says why it did."""
        until = time.monotonic() + _FAREWELL
        number, stamp = self._ticks + 1, self._ticks * self._period
        state = self._last or self._state(packets.LAST)
        try:
            while time.monotonic() < until:
                self._server.send(number, stamp, state)
                while self._server.receive(time.monotonic() + _AGAIN) is not None:
                    if time.monotonic() > until:
                        break
        except LinkError:
            # It has said that it stops, too.
            return
        self._server.say_stop(text)

    def as_data(self) -> dict[str, Any]:
        """The entry of a summary about answers."""
        counts = ("lost", "in_a_row", "late", "repeated", "clipped")
        return {name: getattr(self, name) for name in counts}


def slices_of(parts: Assembly[Plant]) -> dict[str, Vector]:
    """The machine's outputs by name, as views."""
    return {name: parts.bus.view(name) for name in _OUTPUTS}


class Served:
    """The link that serves a program's plant to a remote controller.

    Attributes:
        server: that it is served by.
        options: how.
    """

    #: Its logs have the truth.
    measured = False

    def __init__(self, server: PlantServer, options: ServerOptions) -> None:
        self.server, self.options = server, options
        self._plant: ServedPlant | None = None

    @property
    def lock_step(self) -> bool:
        """Whether the plant waits for each answer."""
        return not self.options.free_running

    def assemble(self, program: Program, world: World) -> Assembly[ServedPlant]:
        """Assembles the parts of the run; answers drive the plant."""
        parts = assemble(program, world, linked=not self.lock_step)
        # Its commands are not applied: what its program cannot answer is no reason to stop.
        parts.machine.followed = False
        plant = parts.plant
        sensing = Sensing(plant.arm, plant.views.equations, parts.machine, world.noise_seed)
        self._plant = ServedPlant(self.server, parts, sensing, self.options)
        return Assembly(program, world, parts.bus, self._plant, parts.machine, sensing=self._plant)

    def finish(self, text: str) -> None:
        """Reports to the controller that the run has ended, and why. May be called twice."""
        if self.server.closed:
            return
        if self._plant is not None:
            self._plant.farewell(text)
        else:
            self.server.say_stop(text)
        self.server.close()

    def as_data(self) -> dict[str, Any]:
        """The entry of a summary about the link."""
        assert self._plant is not None
        mode = "lock-step" if self.lock_step else "free-running"
        said = {"end": "plant", "mode": mode, "name": self.server.client}
        policy: dict[str, Any] = {}
        if not self.lock_step:
            policy = {"stop_after": self.options.stop_after, "slipped": self._plant.slipped}
        return {**said, **policy, "rejected": self.server.rejected, **self._plant.as_data()}


def _servo(robot: Robot, joints: int) -> dict[str, Any]:
    """The entry of a welcome about the arm's servo; none where torques are commanded."""
    if robot.takes_torques:
        return {}
    found = {
        name: np.broadcast_to(value, joints).tolist() if isinstance(value, tuple) else value
        for name, value in robot.servo.numbers.items()
    }
    return {"servo": found}


def welcome(program: Program, options: ServerOptions) -> dict[str, Any]:
    """The welcome of a controller before it drives a plant."""
    context = program.context
    robot, facts = context.robot, RobotFacts.of(program, lock_step=not options.free_running)
    limits, hinges = RobotLimits.of(robot), robot.hinges
    n, outputs = len(facts.joints), dict(fields(len(context.equations)))
    extras = [("gravity", n), ("jacobian", 6 * n), *((name, outputs[name]) for name in _OUTPUTS)]
    live = context.loaded.task.live
    extras += [(name, len(live)) for name in ("param", TARGET) if live]
    return {
        "protocol": packets.VERSION,
        "server": f"taskspec {__version__}",
        "task": context.loaded.task.name,
        "mode": "lock-step" if facts.lock_step else "free-running",
        "period": facts.period,
        "rate": 1 / facts.period,
        "robot": {
            "name": facts.name,
            "joints": list(facts.joints),
            "command": facts.command,
            **_servo(context.loaded.task.robot, n),
            "units": {
                "position": [si_unit(LENGTH.on(rotation=t)) for t in hinges],
                "velocity": [si_unit(VELOCITY.on(rotation=t)) for t in hinges],
                "torque": [si_unit(FORCE.on(rotation=t)) for t in hinges],
            },
            "limits": {
                name: [x if math.isfinite(x) else None for x in getattr(limits, name)]
                for name in ("torque", "velocity", "lower", "upper")
            },
        },
        "wrench": facts.wrench,
        "equations": list(facts.reactions),
        **({"grips": True} if facts.grips else {}),
        "stages": [stage.name for stage in program.stages],
        **({"params": list(live)} if live else {}),
        "extras": [[name, length] for name, length in extras],
        "stop_after": options.stop_after if options.free_running else None,
        "answer_within": options.answer if facts.lock_step else facts.period,
    }
