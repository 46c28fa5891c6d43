"""A run's loop on a robot: its samples become ticks, by its own clock."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.control.qp.dual import dual_solver
from taskspec.deferred_methods import dataclass
from taskspec.program.execution.machine import Machine
from taskspec.program.program import Program
from taskspec.program.worlds import World
from taskspec_runner.errors import InputError, LinkError
from taskspec_runner.link.robot import CommandedRobot, RobotFacts, Sample
from taskspec_runner.loop.assembly import Assembly
from taskspec_runner.record.bus import Bus

Vector = NDArray[np.float64]

#: What a tick is whose sample was lost: one like any other, on the last sample (the clock rules),
#: or none (the task's time stands still for it).
CATCH_UP, HOLD = "catch-up", "hold"
POLICIES = (CATCH_UP, HOLD)
#: Samples in a row that may be lost.
STOP_AFTER = 20
#: A sample is that of a tick if its stamp is nearer than this [periods]. Between a half and one, so
#: that a clock that drifts loses one sample in a while, and not many about the half.
_STAMP_TOLERANCE = 0.75
#: Samples in a row that bring nothing new before a run ends, and for how long [s].
_USELESS, _USELESS_FOR = 1000, 2.0
#: Periods that a robot's clock may go on by at once: what is beyond is no clock.
_FARTHEST = 1e9


@dataclass(frozen=True, slots=True)
class LostPolicy:
    """Policy for samples that do not come.

    Attributes:
        lost: `catch-up` or `hold`.
        stop_after: so many lost in a row end the run when one more is.
    """

    lost: str = CATCH_UP
    stop_after: int = STOP_AFTER

    def __post_init__(self) -> None:
        if self.lost not in POLICIES:
            raise InputError(f"--lost is {' or '.join(POLICIES)}, not {self.lost!r}")
        if self.stop_after < 0:
            raise InputError(f"--stop-after is 0 or more samples, not {self.stop_after}")


class RobotPlant:
    """A robot as the plant of the loop.

    A sample is the tick that its stamp says. One that comes again, or after a later one, is left
    out. For one that did not come the robot has held its last command; `LostPolicy` says what the
    controller makes of it. A sample that comes late is a tick like any other: those that wait are
    taken one by one, each is answered, and the robot takes the newest answer.

    Attributes:
        arm: itself, whose divergence the loop checks.
        diverged: whether the robot has ended.
        lost, in_a_row, late, repeated, reordered, early: samples so far, by what became of them.
    """

    def __init__(self, robot: CommandedRobot, program: Program, bus: Bus, machine: Machine) -> None:
        self.diverged = False
        self.lost = self.in_a_row = self.late = self.repeated = self.reordered = self.early = 0
        self.policy = LostPolicy()
        self._robot, self._machine, self._bus = robot, machine, bus
        self._period, self._n = program.context.period, program.context.robot.n
        self._place = "robot"
        self._started = False
        #: Stamp of tick 0, and number of the tick of the robot's clock that comes next.
        self._begin: float | None = None
        self._due, self._stamp, self._ticks = 0, -math.inf, 0
        self._pending: Sample | None = None
        self._owed, self._lost_now = 0, 0
        declared = program.context.loaded.task.live.items()
        #: What live params begin with, and what they were last set to at the robot [SI].
        self._declared = {name: param.value for name, param in declared}
        self._params = dict[str, float]()
        self._held = self._last = False
        self._delay, self._late_now = math.inf, 0.0

    @property
    def arm(self) -> RobotPlant:
        """The arm, as the loop uses it."""
        return self

    # What the loop calls: `read`, the tick, `step`, `alarm`.

    def read(self) -> None:
        """Gives the controller the next sample, or keeps the last one for a tick without.

        Raises:
            LinkError: there is none.
        """
        try:
            self._read()
        except LinkError as error:
            error.ticks = self._ticks
            raise

    def _read(self) -> None:
        self._held, self._lost_now = False, 0
        if not self._started:
            self._started = True
            self._take(self._robot.read())
            return
        if self._owed:
            self._owed -= 1
            self._held, self._lost_now = True, 1
            return
        sample, self._pending = self._pending, None
        if sample is None:
            sample, lost = self._next()
            if lost:
                self.lost += lost
                self.in_a_row = max(self.in_a_row, lost)
                if lost > self.policy.stop_after:
                    raise LinkError("samples_lost", self._too_many(lost))
                if self.policy.lost == CATCH_UP:
                    self._pending, self._owed = sample, lost - 1
                    self._held, self._lost_now = True, 1
                    return
                self._lost_now = lost
        self._take(sample)

    def _too_many(self, lost: int) -> str:
        return (
            f"{lost} samples in a row were lost, {1e3 * lost * self._period:.4g} ms; up to "
            f"{self.policy.stop_after} would be borne (--stop-after)"
        )

    def _next(self) -> tuple[Sample, int]:
        """The next sample that is a tick, and how many were lost before it."""
        began = math.inf
        for number in range(_USELESS):
            sample = self._robot.read()
            now = time.monotonic()
            # A robot that waits for an answer may have been waited for: from the second one on.
            began = now if number == 0 else began
            if now - began > _USELESS_FOR:
                break
            if self._begin is None:
                self._begin = sample.stamp
            if sample.stamp == self._stamp:
                self.repeated += 1
                continue
            if sample.stamp < self._stamp:
                self.reordered += 1
                continue
            ahead = (sample.stamp - self._begin) / self._period - self._due
            if not ahead < _FARTHEST:
                text = f"the robot's clock goes from {self._stamp:.6g} s to {sample.stamp:.6g} s"
                raise LinkError("bad_stamp", f"{text} at once, which is no time of a run")
            if ahead <= -_STAMP_TOLERANCE:
                self.early += 1
                continue
            lost = round(ahead) if ahead >= _STAMP_TOLERANCE else 0
            self._due, self._stamp = self._due + 1 + lost, sample.stamp
            if self._bus.linked:
                delay = time.perf_counter() - sample.stamp
                self._late_now = max(delay - self._delay, 0.0)
                self._delay = delay
                self.late += self._late_now > self._period
            return sample, lost
        text = f"{number} samples in a row are no later than the last one"
        raise LinkError("no_new_sample", f"{text}; the robot's clock stands or runs back")

    def _take(self, sample: Sample) -> None:
        machine = self._machine
        right = sample.q.shape == sample.v.shape == (self._n,) and sample.wrench.shape == (6,)
        if not right or not all(
            np.isfinite(part).all() for part in (sample.q, sample.v, sample.wrench)
        ):
            text = f"a sample of the robot has not {self._n} positions and velocities and a wrench"
            raise LinkError("bad_sample", f"{text} that are finite numbers")
        machine.q[:], machine.v[:] = sample.q, sample.v
        if machine.sensor is None:
            machine.wrench[:] = sample.wrench
        else:
            machine.sensor.reading[:] = sample.wrench
        if machine.reactions.size:
            machine.reactions[:] = sample.reactions
        self._last = sample.last
        self._follow(sample.params)

    def _follow(self, params: Mapping[str, float]) -> None:
        """Sets the live params that have been set at the robot since its last sample [SI]."""
        live = self._machine.live
        for name, value in params.items():
            if name in self._declared and value != self._params.get(name, self._declared[name]):
                live.set(name, value)
                self._params[name] = value

    def step(self, command: Vector) -> None:
        """Answers the sample; one that never came is not answered.

        Raises:
            LinkError: the robot takes no answer.
        """
        bus = self._bus
        # As measured: nobody knows what is true.
        bus.truth.wrench[:] = self._machine.wrench
        count = len(bus.view("reaction"))
        bus.truth.equations[:count] = bus.view("reaction")
        bus.truth.equations[count:] = self._machine.reactions[count:]
        if bus.linked:
            bus.view("link")[:] = self._late_now, self._lost_now
        if self._last:
            self.diverged = True
        elif not self._held:
            try:
                grip = self._machine.grip
                self._robot.write(np.append(command, grip.command[0]) if grip.used else command)
            except LinkError as error:
                error.ticks = self._ticks
                raise
        self._ticks += 1

    def release(self) -> None:
        """Nothing is left to be done: a robot that is commanded to stop comes to rest itself."""

    def alarm(self) -> tuple[str, str] | None:
        """Why the robot has ended, if it has."""
        if not self._last:
            return None
        return "robot_ended", "the robot has ended the run, and the task is not at its end"

    def as_data(self) -> dict[str, Any]:
        """The entry of a summary about samples."""
        counts = ("lost", "in_a_row", "late", "repeated", "reordered", "early")
        return {name: getattr(self, name) for name in counts}


class OnRobot:
    """The link of a program to a robot.

    Attributes:
        robot: on which.
        policy: for what is lost.
    """

    #: Its logs are of what was measured.
    measured = True

    def __init__(self, robot: CommandedRobot, policy: LostPolicy, where: str) -> None:
        self.robot, self.policy, self._where = robot, policy, where
        self._plant: RobotPlant | None = None
        self._finished = False

    @property
    def lock_step(self) -> bool:
        """Whether the robot waits for each answer."""
        return self.robot.facts.lock_step

    def check(self, program: Program) -> None:
        """Finds out whether it is the robot of a program.

        Raises:
            InputError: it is not.
        """
        RobotFacts.of(program, lock_step=True).check(self.robot.facts, self._where)

    def assemble(self, program: Program, world: World) -> Assembly[RobotPlant]:
        """Assembles the parts of the run; there is no plant."""
        context = program.context
        bus = Bus(context.robot.n, world.task, linked=not self.lock_step)
        measured = (np.zeros(6), np.zeros(len(world.task.reported)))
        views = (bus.view("q"), bus.view("v"), *measured, bus.commanded, bus.outputs)
        machine = program.machine(views, own=dual_solver)
        bus.forget_truth()
        self._plant = plant = RobotPlant(self.robot, program, bus, machine)
        plant.policy = self.policy
        return Assembly(program, world, bus, plant, machine, sensing=plant, measured=True)

    def finish(self, text: str) -> None:
        """Reports to the robot that the run has ended, and why. May be called twice."""
        if not self._finished:
            self._finished = True
            self.robot.stop(text)

    def as_data(self) -> dict[str, Any]:
        """The entry of a summary about the link."""
        assert self._plant is not None
        robot = {"name": self.robot.facts.name, "rejected": getattr(self.robot, "rejected", 0)}
        policy = {"lost": self.policy.lost, "stop_after": self.policy.stop_after}
        mode = "lock-step" if self.lock_step else "free-running"
        return {"end": "controller", "mode": mode, **robot, **policy, **self._plant.as_data()}
