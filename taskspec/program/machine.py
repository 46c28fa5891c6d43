"""The stage machine: ticks the current stage, decides transitions, counts visits and attempts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.control.model_terms import ModelTerms
from taskspec.control.state import AXES
from taskspec.program import entry, events
from taskspec.program.bound import BoundFunction
from taskspec.program.carried import Carried, leave
from taskspec.program.choice import choose_again
from taskspec.program.felt import Estimates
from taskspec.program.ports import OUTPUTS, slices
from taskspec.program.resolver import HELD_TICKS, Asked, Resolver
from taskspec.program.sensor_zero import SensorZero
from taskspec.program.stage import CompiledStage
from taskspec.program.tracks import Tracks
from taskspec.robot import RobotModel

Vector = NDArray[np.float64]
#: q, v, wrench, reactions, torque and outputs of a machine.
Views = tuple[Vector, Vector, Vector, Vector, Vector, Vector]

END, FAIL = "end", "fail"
_FIELDS = slices(OUTPUTS)
_CONDITIONING = _FIELDS["conditioning"].start
_HEALTH = _FIELDS["health"].start


@dataclass(frozen=True, slots=True)
class Transition:
    """A stage that ended.

    Attributes:
        clock: [s] when. stage: that ended. kind, name, text: the event. value: its quantity.
        to: the next stage, `end` or `fail`; empty where a limit stopped the run.
    """

    clock: float
    stage: str
    kind: str
    name: str
    text: str
    value: float
    to: str

    @property
    def good(self) -> bool:
        """Whether the stage ended as planned."""
        return self.kind in (events.UNTIL, events.DONE)


class StageRunner:
    """One stage's function bound to its arrays; CasADi reads and writes them in place."""

    def __init__(
        self, stage: CompiledStage, inputs: tuple[Vector, ...], torque: Vector, outputs: Vector
    ) -> None:
        self.stage = stage
        self.memory = np.zeros(max(stage.memory.size, 1))
        self.parameters = np.zeros(max(stage.parameters.size, 1))
        self._next_memory = np.zeros(max(stage.memory.size, 1))
        self.tracks = Tracks()
        self.least_conditioning = -np.inf if stage.choice is None else stage.choice.least
        memory = self.memory[: stage.memory.size]
        parameters = self.parameters[: stage.parameters.size]
        next_memory = self._next_memory[: stage.memory.size]
        arguments = [*inputs, memory, parameters]
        handed_over = np.zeros(stage.tick.numel_out(3))
        results = [torque, next_memory, outputs, handed_over]
        self._tick = BoundFunction(stage.tick, arguments, results)
        self.evaluate = self._tick.evaluate
        self.resolver: Resolver | None = None
        if stage.resolution is not None:
            slots = stage.parameters.slots
            self.resolver = Resolver(
                stage.resolution, slots, arguments, parameters, handed_over, torque, outputs
            )

    def load(self, entered: entry.Entered) -> None:
        """Starts the stage with the numbers of its entry."""
        size = self.stage
        self.memory[: size.memory.size] = entered.memory
        self.parameters[: size.parameters.size] = entered.parameters
        self.tracks = entered.tracks
        self.next_knot = self.tracks.next_knot

    def commit(self) -> None:
        """Makes the memory of the last evaluation current."""
        self.memory[:] = self._next_memory

    def refresh(self, t: float) -> None:
        """Renews the cubics that change at stage time t [s]."""
        self.tracks.refresh(self.stage, self.parameters, t)
        self.next_knot = self.tracks.next_knot


class Machine:
    """Runs compiled stages tick by tick.

    Write `q`, `v`, `reactions` and `wrench` (or, where there is a `sensor`, its reading), call
    `tick`, read `torque` and `outputs`.

    Attributes:
        q, v: (n,) measured joint positions and velocities.
        wrench: (6,) measured, by the environment on the tool tip, world axes [N, N m].
        reactions: (equations,) measured, what the robot applies along each equation's unit
            gradient [N, N m]; those on the tip are told from the wrench instead.
        sensor: makes the wrench from readings; None where the wrench is written itself.
        period: of control [s].
        torque: (n,) the command [N m]. outputs: the numbers of `ports.fields`.
        index: number of the current stage. t: [s] since it began.
        ended: `end` or `fail` once the task is over, else empty. transitions: so far.
    """

    def __init__(
        self,
        robot: RobotModel,
        stages: tuple[CompiledStage, ...],
        period: float,
        views: Views,
        sensor: SensorZero | None = None,
        estimates: Estimates | None = None,
    ) -> None:
        self._robot, self.period = robot, period
        self.sensor, self._estimates = sensor, estimates
        self._learns = False
        self._terms = ModelTerms(robot)
        self.q, self.v, self.wrench, self.reactions, self.torque, self.outputs = views
        self._now = np.zeros(2 + len(stages))
        self._inputs = (self._now, self.q, self.v, *self._terms.arrays, self.wrench, self.reactions)
        self._runners = tuple(
            StageRunner(s, self._inputs, self.torque, self.outputs) for s in stages
        )
        self._names = [s.name for s in stages]
        self.index, self.t = 0, 0.0
        self._ticks = self._held = 0
        self._safe, self._applied = np.zeros(len(self.torque)), np.zeros(len(self.torque))
        self._runner = self._runners[0]
        self.ended = ""
        self.transitions: list[Transition] = []

    @property
    def stage(self) -> CompiledStage:
        """The current stage."""
        return self._runner.stage

    @property
    def resolver(self) -> Resolver | None:
        """What keeps the limits of the current stage; None without a program."""
        return self._runner.resolver

    @property
    def visits(self) -> Mapping[str, int]:
        """How often each stage has been entered."""
        return {name: int(self._now[2 + i]) for i, name in enumerate(self._names)}

    def start(self) -> None:
        """Enters the first stage from rest at the measured pose."""
        self.update_terms()
        self.torque[:] = self._gravity
        p, R = self._tip()
        self._enter(0, Carried(p, R, np.zeros(6)), 0.0)

    def asked(self, index: int, t: float) -> Asked | None:
        """What stage `index` asks of contacts at its time t [s], were it entered at rest here.

        None for a stage that solves no program, asks for no force, or begins in a frame that is
        yet to be felt.
        """
        runner = self._runners[index]
        parameters = runner.stage.parameters
        if runner.resolver is None or (
            self._estimates is not None and self._estimates.missing(parameters)
        ):
            return None
        self.update_terms()
        p, R = self._tip()
        self._enter(index, Carried(p, R, np.zeros(6)), 0.0)
        self._now[0] = t
        runner.evaluate()
        return runner.resolver.asked()

    def update_terms(self) -> None:
        """Evaluates the model terms and the contact wrench at the measured joint state."""
        self._terms.update(self.q, self.v)
        if self.sensor is not None:
            self.sensor.correct(self._tip()[1], self.wrench)

    def tick(self, clock: float) -> float:
        """One control period at run time `clock` [s].

        Returns:
            0.0 while the current stage goes on; otherwise the event's number has been dealt with:
            the machine has moved to another stage (and computed its first torque) or has ended.
        """
        self._terms.update(self.q, self.v)
        if self.sensor is not None:
            self.sensor.correct(self._tip()[1], self.wrench)
        now, runner = self._now, self._runner
        self._applied[:] = self.torque
        now[0] = t = self.t = self._ticks * self.period
        now[1] = clock
        if t >= runner.next_knot:
            runner.refresh(t)
        if self.outputs[_CONDITIONING] < runner.least_conditioning:
            choose_again(runner.stage, self._inputs, runner.memory, runner.parameters, t)
        fresh = self._evaluate(runner)
        self._ticks += 1
        event = self.outputs[0]
        if not fresh:
            stopped = self._hold(runner, clock)
            if stopped or not (event and self._is_limit(event)):
                return stopped
        if event and (self._ticks > 1 or self._is_limit(event)):
            self._change(clock, runner.stage.events[int(event) - 1])
        else:
            runner.commit()
            if self._learns:
                self._collect()
        return float(event)

    def _evaluate(self, runner: StageRunner) -> bool:
        """Evaluates a tick and keeps its limits; whether there is a torque that may be used."""
        resolver = runner.resolver
        if resolver is None:
            runner.evaluate()
            return True
        resolver.remember(self._applied)
        runner.evaluate()
        if not resolver.resolve():
            return False
        self._held = 0
        return True

    def _hold(self, runner: StageRunner, clock: float) -> float:
        """Lets the last torque that kept its limits fade to what carries the arm, then stops.

        Memory is not committed: the tick did not happen. Returns the number of an event.
        """
        assert runner.resolver is not None
        if self._held == 0:
            self._safe[:] = self._applied
        self._held += 1
        if self._held > HELD_TICKS:
            why = runner.resolver.status.value
            text = f"the program that keeps the limits has had no answer for {HELD_TICKS} ticks"
            self.ended = FAIL
            self.torque[:] = self._gravity
            self._note(clock, events.Event(events.LIMIT, "solver", f"{text}: {why}"), 0.0, "")
            return 1.0
        share = 1.0 - self._held / HELD_TICKS
        self.torque[:] = self._gravity + share * (self._safe - self._gravity)
        # What the tick could not compute is no reason to stop yet.
        self.outputs[_HEALTH] = 0.0
        return 0.0

    @property
    def _gravity(self) -> Vector:
        """(n,) torque that carries the arm at the measured joint positions."""
        return self._terms.arrays[2]

    def _is_limit(self, event: float) -> bool:
        """A stage's first tick heeds limits alone: what ends it well takes at least a tick."""
        return self.stage.events[int(event) - 1].kind == events.LIMIT

    def _change(self, clock: float, event: events.Event) -> None:
        stage = self.stage
        value = float(self.outputs[1])
        if event.kind == events.LIMIT:
            self.ended = FAIL
            self._note(clock, event, value, "")
            return
        good = event.kind in (events.UNTIL, events.DONE)
        following = self._names[self.index + 1] if self.index + 1 < len(self._names) else END
        to = (stage.spec.next or following) if good else (stage.spec.on_fail or FAIL)
        if to in (END, FAIL):
            self.ended = to
            self._note(clock, event, value, to)
            return
        index = self._names.index(to)
        attempts = self._runners[index].stage.spec.attempts
        if attempts is not None and self._now[2 + index] >= attempts:
            self.ended = FAIL
            text = f"{event.text}; stage {to!r} has had its {attempts} attempts"
            self._note(clock, events.Event(event.kind, "attempts", text), value, FAIL)
            return
        carried = leave(stage, self.named_outputs(), clock)
        if self._learns:
            self._learn(stage)
        unknown = (
            self._estimates.missing(self._runners[index].stage.parameters)
            if (self._estimates is not None)
            else ""
        )
        if unknown:
            self.ended = FAIL
            text = f"stage {to!r} cannot begin: {unknown}"
            self._note(clock, events.Event(events.LIMIT, "frame_not_felt", text), 0.0, "")
            return
        self._note(clock, event, value, to)
        self._enter(index, carried, clock)
        # The new stage's tick at t = 0 is this one; what the old one made of it was not applied.
        self.torque[:] = self._applied
        fresh = self._evaluate(self._runner)
        self._ticks = 1
        first = self.outputs[0]
        if not fresh:
            self._hold(self._runner, clock)
        if first and self._is_limit(first):
            self._change(clock, self.stage.events[int(first) - 1])
            return
        if not fresh:
            return
        self._runner.commit()
        if self._learns:
            self._collect()

    def _collect(self) -> None:
        """Keeps what this tick of the stage measured, for its end."""
        if self.sensor is not None:
            self.sensor.collect()
        if self._estimates is not None:
            self._estimates.collect(self.wrench[:3])

    def _learn(self, stage: CompiledStage) -> None:
        """Takes from a stage that ends the sensor's zero, and the frames that it has felt."""
        p, R = self._tip()
        if self._estimates is not None:
            self._estimates.end(stage.name, p)
        if self.sensor is not None and stage.spec.tare:
            self.sensor.tare()
            self.sensor.correct(R, self.wrench)

    def _note(self, clock: float, event: events.Event, value: float, to: str) -> None:
        self.transitions.append(
            Transition(clock, self.stage.name, event.kind, event.name, event.text, value, to)
        )

    def _enter(self, index: int, carried: Carried, clock: float) -> None:
        self.index, self._runner = index, self._runners[index]
        self._ticks, self.t = 0, 0.0
        self.outputs[_CONDITIONING] = 1.0
        self._now[0], self._now[1] = 0.0, clock
        self._now[2 + index] += 1
        stage, poses = self._runner.stage, {}
        self._learns = stage.spec.tare
        if self.sensor is not None:
            self.sensor.begin()
        if self._estimates is not None:
            self._learns |= stage.name in self._estimates.stages
            self._estimates.begin()
            poses = self._estimates.poses
        self._runner.load(
            entry.enter(stage, self._robot, carried, self._tip(), self._inputs, poses)
        )
        self._settle()

    def _settle(self) -> None:
        """Takes from a new stage what contacts cannot return, before its first tick."""
        resolver = self._runner.resolver
        if resolver is None:
            return
        before = self.torque.copy()
        self._runner.evaluate()
        resolver.settle()
        self.torque[:] = before

    def not_finite(self) -> str:
        """Which reference of the last tick is not a number; empty where none is to blame."""
        outputs = self.named_outputs()
        for name, plan in self.stage.plans.items():
            i = AXES.index(name)
            for kind, there in (("position", plan.motion), ("velocity", plan.motion)):
                if there and not np.isfinite(outputs[f"{kind}_ref"][i]):
                    return f"{kind}.{name}"
            if plan.set_point and not np.isfinite(outputs["force_ref"][i]):
                return f"{'torque' if name.startswith('r') else 'force'}.{name}"
        return ""

    def _tip(self) -> tuple[Vector, Vector]:
        p, R = self._terms.arrays[4], self._terms.arrays[5].reshape(3, 3, order="F")
        tip = self._robot.tip
        return p + R @ tip.translation, R @ tip.rotation

    def named_outputs(self) -> dict[str, Vector]:
        """The last outputs by name."""
        return {name: self.outputs[where] for name, where in _FIELDS.items()}
