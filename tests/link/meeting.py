"""A plant that is served, a controller that drives it, and what may go wrong in between."""

from __future__ import annotations

import random
import select
import socket
import threading
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from taskspec.compiler import compile_unchecked
from taskspec.program.program import Program
from taskspec.spec import load_task, load_text
from taskspec_runner.errors import LinkError
from taskspec_runner.link.address import Endpoint
from taskspec_runner.link.on_robot import LostPolicy, OnRobot
from taskspec_runner.link.robot import CommandedRobot, RobotFacts, RobotLimits, Sample
from taskspec_runner.link.server import PlantServer, Served, ServerOptions, welcome
from taskspec_runner.link.simulated import SimulatedRobot
from taskspec_runner.link.udp_robot import UdpRobot
from taskspec_runner.loop.live_requests import setting
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program

Vector = NDArray[np.float64]

ROOT = Path(__file__).resolve().parents[2]

#: Touches a wall and presses on it.
TOUCH = """\
taskspec: 1
name: touch
robot:
  model: planar2
  start: {xyz: [400 mm, 100 mm, 0]}
world:
  wall:
    {shape: plane, xyz: [402 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 10 kN/m, damping: 30 N*s/m}
stages:
  approach:
    axes: {x: {velocity: 20 mm/s}, y: {position: 5 mm * sin(2*pi*t/(0.2 s))}}
    until: force.x > 1 N
    within: {time: 0.4 s}
  hold:
    axes: {x: {force: 5 N, ramp: 50 ms}}
    time: 0.3 s
expect:
  - last(hold.force.x) within 5 N +- 0.5 N
  - max(abs(hold.error.y)) < 1 mm
"""
#: The same with a sensor that has noise, a bias, a filter and a delay, which is tared.
SENSED = TOUCH.replace(
    "  start:",
    "  sensor: {noise: 0.05 N, bias: [0.3 N, 0, 0, 0, 0, 0], filter: 200 Hz, delay: 2 ms}\n"
    "  start:",
).replace("stages:\n", "stages:\n  tare: {axes: {}, time: 50 ms, tare: true}\n")

_SERVO = "servo: {bandwidth: 50 Hz, delay: 2 ms, acceleration: 20 rad/s^2}"
#: The same of an arm that takes velocities, and of one that takes positions.
VELOCITIES, POSITIONS = (
    TOUCH.replace("  start:", f"  command: {command}\n  {_SERVO}\n  start:").replace(
        "stages:\n", f"law: {law}\nstages:\n"
    )
    for command, law in (("velocity", "admittance"), ("position", "force-velocity"))
)

#: A constraint on joints, whose reactions are measured beside the wrench.
RAIL = """\
taskspec: 1
name: rail
robot: {model: planar3, start: {xyz: [400 mm, 200 mm, 0], rpy: [0, 0, 0]}}
world:
  bars: {equation: "q1 + q2 + q3 = 0", stiffness: 2 kN*m/rad, damping: 5 N*m*s/rad}
law: hybrid-multipliers
stages:
  load:
    constraints: {bars: {torque: 2 N*m}}
    time: 0.3 s
  right:
    constraints: {bars: {torque: 2 N*m}}
    axes: {x: {move: 20 mm}, y: hold}
expect:
  - max(abs(bars.gap)) < 0.1 deg
  - right.bars.torque within 2 N*m +- 50 mN*m
"""


@cache
def program_of(task: str) -> Program:
    """A compiled task: a text, or the name of a shipped one."""
    loaded = load_text(task, "task.yaml") if "\n" in task else load_task(shipped(task))
    return compile_unchecked(loaded)


def shipped(name: str) -> Path:
    return ROOT / "tasks" / f"{name}.yaml"


class Serving:
    """A thread that serves a task's plant for one run.

    Attributes:
        url: where.
        port: of it.
    """

    def __init__(
        self,
        task: str,
        out: Path,
        options: ServerOptions | None = None,
        live: Sequence[str] = (),
    ) -> None:
        self._program, self._out, self._live = program_of(task), out, live
        self._options = options or ServerOptions(wait=20.0)
        self._server = PlantServer(Endpoint("127.0.0.1", 0))
        self.url, self.port = self._server.endpoint.text, self._server.endpoint.port
        self._run: Run | None = None
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> Serving:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: object, __: TracebackType | None
    ) -> None:
        self._thread.join(60)
        self._server.close()
        assert not self._thread.is_alive()
        if self._error is not None and kind is None:
            raise self._error

    def _serve(self) -> None:
        try:
            options = self._options
            self._server.wait(welcome(self._program, options), options.wait)
            served = Served(self._server, options)
            context = self._program.context
            with setting(self._live, context.loaded.task, context.period) as hand:
                self._run = execute_program(
                    self._program, self._out, report=False, link=served, hand=hand
                )
        except BaseException as error:
            self._error = error

    @property
    def run(self) -> Run:
        """The run of whoever drove it, when it has ended."""
        self._thread.join(60)
        if self._error is not None:
            raise self._error
        assert self._run is not None
        return self._run


def drive(task: str, robot: CommandedRobot, out: Path, policy: LostPolicy | None = None) -> Run:
    """Runs a task on a robot."""
    link = OnRobot(robot, policy or LostPolicy(), "test")
    link.check(program_of(task))
    return execute_program(program_of(task), out, report=False, link=link)


def drive_at(task: str, url: str, out: Path, policy: LostPolicy | None = None) -> Run:
    """Runs a task on what listens at an address."""
    return drive(task, UdpRobot(url, patience=20.0), out, policy)


def log_bytes(run: Run) -> bytes:
    return (run.folder / "log.arrow").read_bytes()


def same_bits(run: Run, other: Run, names: Iterable[str]) -> None:
    for name in names:
        a, b = run.history.columns[name], other.history.columns[name]
        assert np.array_equal(a, b, equal_nan=True), name


#: What a controller has of itself, and what it measures as it is.
def own_columns(run: Run) -> list[str]:
    truth, names = ("force.", "torque.", "touching", "power", "link."), [*run.history.columns]
    # What is measured is true a tick later.
    late = {name for name in names if f"{name}.measured" in names}
    own = (".ref", ".measured")
    return [n for n in names if n.endswith(own) or not (n in late or n.startswith(truth))]


class ClockedRobot:
    """A simulated robot whose clock goes on: samples by a script, torques held in between.

    Attributes:
        plant_ticks: of the robot's own clock so far.
    """

    def __init__(
        self,
        program: Program,
        *,
        lost: Iterable[int] = (),
        twice: Iterable[int] = (),
        swapped: Iterable[int] = (),
        scale: float = 1.0,
        ends_at: int | None = None,
    ) -> None:
        """Ticks, from 0, of which the sample is lost, comes twice, or comes after the next one.

        `scale` is how much faster than it says its clock goes; at `ends_at` the robot is gone.
        """
        self._robot = SimulatedRobot(program)
        facts = self._robot.facts
        self.facts: RobotFacts = RobotFacts(
            *(facts.name, facts.joints, facts.period, facts.wrench, facts.reactions),
            lock_step=False,
            command=facts.command,
        )
        self.limits: RobotLimits = self._robot.limits
        self._lost, self._twice, self._swapped = set(lost), set(twice), set(swapped)
        self._scale, self._ends_at = scale, ends_at
        self._torque: Vector | None = None
        self._queue: deque[Sample] = deque()
        self.plant_ticks, self._started, self.stopped = 0, False, ""

    def read(self) -> Sample:
        if not self._started:
            self._started = True
            return self._robot.read()
        while not self._queue:
            self._go_on()
        return self._queue.popleft()

    def _go_on(self) -> None:
        tick = self.plant_ticks
        if tick == self._ends_at:
            raise LinkError("connection_lost", "nobody is there any more")
        if tick:
            assert self._torque is not None
            self._robot.write(self._torque)
        self.plant_ticks += 1
        sample = self._robot.read()
        sample.stamp *= self._scale
        if tick in self._lost:
            return
        self._queue.append(sample)
        if tick in self._twice:
            self._queue.append(sample)
        if tick - 1 in self._swapped:
            self._queue.append(self._held)
        if tick in self._swapped:
            self._held = self._queue.pop()

    def write(self, torque: Vector) -> None:
        self._torque = torque.copy()

    def stop(self, reason: str) -> None:
        self.stopped = reason


class Proxy:
    """An address between a controller and a plant that loses, doubles, delays and invents.

    Attributes:
        url: for the controller.
    """

    def __init__(self, port: int, seed: int, **shares: float) -> None:
        """Before the plant at `port`; shares are of packets to `drop`, to be sent `twice`, to be
        `late` (overtaken by the next one), and to be followed by `rubbish`."""
        self._front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._back = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._front.bind(("127.0.0.1", 0))
        self._back.connect(("127.0.0.1", port))
        # What is announced may be gone when it is asked for.
        self._front.setblocking(False)
        self._back.setblocking(False)
        self.url = f"udp://127.0.0.1:{self._front.getsockname()[1]}"
        self._shares, self._dice = shares, random.Random(seed)
        self._over, self._client = threading.Event(), None
        self._waiting: dict[socket.socket, bytes] = {}
        self._thread = threading.Thread(target=self._pump)

    def __enter__(self) -> Proxy:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join(10)
        assert not self._thread.is_alive()
        self._front.close()
        self._back.close()

    def _happens(self, what: str) -> bool:
        return self._dice.random() < self._shares.get(what, 0.0)

    def _pump(self) -> None:
        while not self._over.is_set():
            for ready in select.select([self._front, self._back], [], [], 0.05)[0]:
                with suppress(OSError):
                    data, sender = ready.recvfrom(65535)
                    if ready is self._front:
                        self._client = sender
                    self._pass_on(ready, data)

    def _pass_on(self, came_by: socket.socket, data: bytes) -> None:
        if self._happens("drop"):
            return
        held = self._waiting.pop(came_by, None)
        if held is None and self._happens("late"):
            self._waiting[came_by] = data
            return
        for each in [data] * (1 + self._happens("twice")) + [held] * (held is not None):
            self._send(came_by, each)
        if self._happens("rubbish"):
            self._send(came_by, spoilt(data, self._dice))

    def _send(self, came_by: socket.socket, data: bytes) -> None:
        if came_by is self._front:
            self._back.send(data)
        else:
            self._front.sendto(data, self._client)


def spoilt(data: bytes, dice: random.Random) -> bytes:
    """A packet with something wrong: cut, longer, some bytes changed, or nothing but chance."""
    kind = dice.randrange(4)
    if kind == 0:
        return data[: dice.randrange(len(data))]
    if kind == 1:
        return data + dice.randbytes(dice.randrange(1, 40))
    if kind == 2:
        return dice.randbytes(dice.randrange(0, 400))
    changed = bytearray(data)
    for _ in range(dice.randrange(1, 6)):
        changed[dice.randrange(len(changed))] ^= dice.randrange(1, 256)
    return bytes(changed)
