"""The stage machine: ticks the current stage, decides transitions, counts visits and attempts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program import events
from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.program.execution.estimation import Estimation
from taskspec.program.execution.exits import (
    OVER,
    RESTS,
    TRIED,
    enter,
    exit_table,
    follows,
    repeats,
)
from taskspec.program.execution.fade_out import FadeOut, unanswered
from taskspec.program.execution.gripping import begin_stage, grip_table, hand_load
from taskspec.program.execution.live_params import LiveParams
from taskspec.program.execution.payload_estimate import PayloadEstimate, adaptation
from taskspec.program.execution.sensor_zero import sensor_zero
from taskspec.program.execution.stage_runner import StageRunner
from taskspec.program.execution.stage_solver import (
    OwnSolver,
    ReturnedForces,
    StageSolver,
    no_own_solver,
)
from taskspec.program.execution.transition import FAIL, Exit, Transition, exits
from taskspec.program.execution.velocity_estimator import VelocityEstimator
from taskspec.program.ports import (
    HANDED,
    INTERNAL,
    fields_of,
    first_live,
    handed_of,
    now_at_start,
    payload_place,
    slices,
)
from taskspec.program.reference.axis_plan import not_finite
from taskspec.program.stages.stage import CompiledStage
from taskspec.program.velocity_estimate import VelocityEstimate
from taskspec.program.world.estimated_frames import Estimates
from taskspec.robot import RobotModel
from taskspec.robot.model_terms import ModelTerms
from taskspec.spec import Task

Vector = NDArray[np.float64]
#: q, v, wrench, reactions, torque and outputs of a machine.
Views = tuple[Vector, Vector, Vector, Vector, Vector, Vector]

_FIELDS = slices(INTERNAL)
_CONDITIONING = _FIELDS["conditioning"].start
_HEALTH = _FIELDS["health"].start
_HANDED = slices(HANDED)
_SAME = _HANDED["same"].start
#: A stage that has gone on for so many ticks goes on for long enough to group its instructions.
_GROUPS_AFTER = 1000


@dataclass(slots=True)
class Opening:
    """A stage that has been entered, before its first tick.

    Attributes:
        clock: run time [s].
        carries: whether its torque goes on from there.
        rests: for how long limits do not count yet [s], by name.
    """

    clock: float
    carries: bool
    rests: Mapping[str, float]


class Machine:
    """Runs compiled stages tick by tick; one that is not compiled ends the task.

    Write `q`, `v`, `reactions` and `wrench` (or, where there is a `sensor`, its reading), call
    `tick`, read `torque` and `outputs`.

    Attributes:
        q, v: (n,) measured joint positions and velocities; those it estimates it writes itself.
        wrench: (6,) measured, by the environment on the tool tip, world axes [N, N m].
        reactions: (equations,) measured, what the robot applies along each equation's unit
            gradient [N, N m]; those on the tip are computed from the wrench instead.
        sensor: makes the wrench from readings; None where the wrench is written itself.
        payload: that laws adapt to; None where none does.
        estimator: of joint velocities; None where they are measured.
        period: of control [s].
        runners: of the stages, in their order; `runner` is that of the current one.
        terms: the model terms.
        drives: what the joints are commanded.
        rest: (n,) what an arm at rest is commanded: the torques that carry it, no
            velocity, or where it stands.
        now: stage time, run time [s], how often each stage has been entered, and the params that
            may be set, with their rates.
        live: these params.
        grip: the gripper.
        estimation: what is measured for later stages.
        counts: which stage follows an event, and how often stages have been entered.
        handed: the numbers of `handed_of`, as the current stage got them.
        torque: (n,) the command [N m].
        applied: (n,) that of the tick before, while a tick is made [N m].
        earlier: (n,) the one before that.
        last: (n,) what the stage before made of the tick on which it ended [N m].
        outputs: the numbers of `ports.fields`.
        index: number of the current stage.
        t: [s] since it began.
        stage_ticks: since it began.
        ended: `end` or `fail` once the task is over, else empty.
        transitions: so far.
        followed: whether its torques drive the arm; else it runs beside another controller, whose
            torques are written into `torque`, and a program of its own without an answer ends
            nothing.
        groups: whether a stage that lasts has its instructions grouped, which pays after some
            thousand ticks more.
    """

    def __init__(
        self,
        robot: RobotModel,
        stages: tuple[CompiledStage, ...],
        period: float,
        views: Views,
        estimates: Estimates | None = None,
        terms: type[ModelTerms] = CompiledTerms,
        own: OwnSolver = no_own_solver,
    ) -> None:
        self.period = period
        self.q, self.v, self.wrench, self.reactions, self.torque, self.outputs = views
        task = stages[0].plan.context.loaded.task
        self.now = now_at_start(task)
        self.grip = grip_table(task, self.now, self.reactions)
        self._grips = bool(self.grip.used)
        load = (np.asarray(self.grip.load),) if self._grips else ()
        self.terms = terms(robot, self.q, self.v, *load)
        self.drives = stages[0].plan.context.drives
        self.rest = self.terms.gravity if self.drives.torques else np.zeros(robot.n)
        self.estimator: VelocityEstimator | None = None
        estimate = VelocityEstimate.of(task.control.velocity, period)
        if estimate is not None:
            own_state, arrays = (self.q, self.v), self.terms.arrays
            self.estimator = VelocityEstimator(
                estimate, robot, own_state, arrays, self.wrench, self.torque
            )
        self.live = LiveParams(task.live, self.now, first_live(task))
        self._moves = bool(self.live)
        self.payload = payload_estimate(self, task, robot)
        self.sensor = sensor_zero(task, task.robot.sensor, robot, self.payload, *load)
        self.estimation = Estimation(self.sensor, estimates)
        self._inputs = (self.now, self.q, self.v, *self.terms.arrays, self.wrench, self.reactions)
        self.handed = np.zeros(sum(length for _, length in handed_of(task, robot.n)))
        self.applied, self.earlier, self.last = np.zeros((3, len(self.torque)))
        # Memory gives and takes a number in half the time that an array does.
        self._now: Any = self.now.data
        self._outputs: Any = self.outputs.data
        self._torque, self._applied = self.torque.data, self.applied.data
        self._fading = FadeOut(len(self.torque))
        self.runners = tuple(
            StageRunner(s, self._inputs, self.handed, self.torque, self.last, self.outputs, own)
            for s in stages
        )
        self._exits = exits(stages)
        self.counts = exit_table(stages)
        self.followed = True
        self.groups = True
        #: What the kernel shares with it; see `controller_memory`.
        self.memories: tuple[Any, ...] | None = None
        self._declared = self.now.copy()
        self._begin_anew()

    def _begin_anew(self) -> None:
        self.index, self.t = 0, 0.0
        self.stage_ticks = 0
        self.runner = self.runners[0]
        self.ended = ""
        self.transitions: list[Transition] = []

    @property
    def renewable(self) -> bool:
        """Whether `renew` leaves nothing of a run: solvers, choosers and estimates remember it."""
        remembers = (each.solver or each.chooser for each in self.runners)
        return self.estimation.estimates is None and not any(remembers)

    def renew(self) -> None:
        """Makes it as it was before a run, on the same arrays: to build one takes longer.

        What a stage has of its own its entry writes anew.
        """
        assert self.renewable
        for array in (self.q, self.v, self.wrench, self.reactions, self.torque, self.outputs):
            array[:] = 0.0
        for array in (self.handed, self.applied, self.earlier, self.last):
            array[:] = 0.0
        self.now[:] = self._declared
        self.live.renew()
        for held in (self.grip.mass, self.grip.full):
            np.asarray(held)[:] = 0.0
        self._fading.reset()
        if self.sensor is not None:
            self.sensor.renew()
        if self.payload is not None:
            self.payload.renew()
        for counted in (self.counts.tries, self.counts.rounds):
            np.asarray(counted)[:] = 0
        for runner in self.runners:
            runner.renew()
        self._begin_anew()

    @property
    def stage(self) -> CompiledStage:
        """The current stage."""
        return self.runner.stage

    @property
    def solver(self) -> StageSolver | None:
        """The solver of the current stage; None without a program."""
        return self.runner.solver

    @property
    def visits(self) -> Mapping[str, int]:
        """Number of times that each stage has been entered."""
        return {each.stage.name: int(self.now[2 + i]) for i, each in enumerate(self.runners)}

    def start(self) -> None:
        """Enters the first stage from rest at the measured pose."""
        if self.estimator is not None:
            self.estimator.begin()
        self.torque[:] = self.applied[:] = self.earlier[:] = self.at_rest()
        self._rest_here()
        self._begin(0)
        self._enter(0.0)

    def at_rest(self) -> Vector:
        """(n,) what the arm is commanded to rest where it is measured; evaluates the terms."""
        self.update_terms()
        if self.drives.positions:
            self.rest[:] = self.q
        return self.rest

    def returned_forces(self, index: int, t: float) -> ReturnedForces | None:
        """What stage `index` requests of contacts at its time t [s], were it entered at rest here.

        None for a stage that solves no program, requests no force, or begins in a frame that is
        yet to be estimated.
        """
        runner = self.runners[index]
        if runner.solver is None or self.estimation.missing(runner.stage):
            return None
        self.update_terms()
        self._rest_here()
        self._begin(index)
        self._enter(0.0)
        self.now[0] = t
        runner.tick.evaluate()
        return runner.solver.returned_forces()

    def _rest_here(self) -> None:
        """Hands over a reference that rests where the tip is measured."""
        self.handed[:] = 0.0
        self.handed[_HANDED["p"]], R = self.terms.tip()
        self.handed[_HANDED["R"]] = R.ravel(order="F")

    def update_terms(self) -> None:
        """Evaluates the model terms and the contact wrench at the measured joint state."""
        hand_load(self.grip)
        self.terms.update()
        if self.sensor is not None:
            self.sensor.correct(self.terms.tip()[1], self.wrench)
        if self.payload is not None:
            self.payload.carry()

    def tick(self, clock: float) -> float:
        """One control period at run time `clock` [s].

        Returns:
            0.0 while the current stage goes on; otherwise the event's number has been dealt with:
            the machine has moved to another stage (and computed its first torque) or has ended.
        """
        if self.estimator is not None:
            self.estimator.correct.evaluate()
        self.update_terms()
        now, outputs, runner = self._now, self._outputs, self.runner
        self._applied[:] = self._torque
        ticks = self.stage_ticks
        now[0] = t = self.t = ticks * self.period
        now[1] = clock
        if self._moves:
            self.live.move(clock)
        if t >= runner.tracks.next_knot:
            runner.refresh(t)
        if outputs[_CONDITIONING] < runner.least_conditioning:
            assert runner.chooser is not None
            runner.chooser.again(t)
        fresh = self._evaluate(runner)
        self.stage_ticks = ticks = ticks + 1
        if ticks == _GROUPS_AFTER and self.groups:
            self._group()
        event: float = outputs[0]
        if not fresh:
            stopped = self._hold(runner, clock)
            if stopped or not (event and self._is_limit(event)):
                self.earlier[:] = self.applied
                self.predict()
                return stopped
        if event and (ticks > 1 or self._is_limit(event)):
            self._change(clock)
        else:
            self._commit(runner)
            self.earlier[:] = self.applied
            self.predict()
        return event

    def _commit(self, runner: StageRunner) -> None:
        """Makes the tick of a stage one that happened."""
        runner.commit()
        if self.estimation.on:
            self.estimation.collect(self.wrench)
        if self.payload is not None:
            self.payload.commit(adapts=runner.stage.plan.adapts)

    def predict(self) -> None:
        """Takes note of the torque that the arm has got, by which its velocity is estimated."""
        if self.estimator is not None:
            self.estimator.predict.evaluate()

    def look(self, clock: float) -> None:
        """Measures at run time `clock` [s] as the current stage does, which commands nothing.

        Model terms and outputs are those of this instant; the torque is for the caller to write.
        """
        if self.estimator is not None:
            self.estimator.correct.evaluate()
        self.update_terms()
        self.now[1] = clock
        self.live.move(clock)
        self.runner.tick.evaluate()

    def has_run(self, ticks: int) -> None:
        """Takes note of ticks of the current stage that were made on this machine's arrays."""
        self.stage_ticks += ticks
        self.t = (self.stage_ticks - 1) * self.period
        self._fading.reset()

    def leave(self, clock: float) -> Opening | None:
        """Ends the stage by the event of a tick that was made, and handed on, on these arrays.

        Args:
            clock: run time [s].

        Returns:
            The stage that follows, to be opened here or by the loop that made the tick; None
            where the task has ended.
        """
        self.t = self.stage_ticks * self.period
        self.stage_ticks += 1
        self._fading.reset()
        return self._leave(clock, handed=True)

    def has_opened(self, step: float, carried: float) -> None:
        """Takes note of a stage that another loop has opened, by its torque's step [N m]."""
        last = self.transitions[-1]
        last.torque_step, last.torque_carried = step, carried

    def _evaluate(self, runner: StageRunner) -> bool:
        """Evaluates a tick and keeps its limits; whether there is a torque that may be used."""
        fresh = runner.answer(self.applied, self.earlier)
        if fresh:
            self._fading.reset()
        return fresh

    def _hold(self, runner: StageRunner, clock: float) -> float:
        """Lets the last torque that kept its limits fade to what carries the arm, then stops.

        Torques, their rate and the joints' limits are kept as well as in any other tick. Memory is
        not committed: the tick did not happen. Returns the number of an event.
        """
        assert runner.solver is not None
        if self.payload is not None:
            self.payload.forget()
        if self.drives.positions:
            wanted = self._fading.slow(self.applied, self.earlier)
        else:
            wanted = self._fading.step(self.applied, self.rest)
        runner.solver.hold(wanted)
        if self._fading.over and self.followed:
            self._end(clock, unanswered(runner.solver.status), 0.0, "")
            return 1.0
        # What the tick could not compute is no reason to stop yet.
        self.outputs[_HEALTH] = 0.0
        return 0.0

    def _is_limit(self, event: float) -> bool:
        """A stage's first tick heeds limits alone: what ends it well takes at least a tick."""
        return self._exits[self.index][int(event) - 1].event.is_limit

    def _change(self, clock: float) -> None:
        """Ends the stage by an event, and opens the one that follows it, if any may."""
        opening = self._leave(clock)
        if opening is not None:
            self.open(opening)

    def _leave(self, clock: float, *, handed: bool = False) -> Opening | None:
        """Ends the stage by the event of the last outputs; the next one, if any may begin.

        Args:
            clock: run time [s].
            handed: whether the stage has handed on what it has to, its torque too, and has added up
                the forces that it collected.
        """
        out: Exit = self._exits[self.index][int(self.outputs[0]) - 1]
        event, to, value = out.event, out.to, float(self.outputs[1])
        number = int(self.outputs[0])
        again = repeats(self.counts, self.index, number)
        index = follows(self.counts, self.index, number)
        if index == OVER:
            self._end(clock, event, value, to)
            return None
        if again:
            to = self.stage.name
        if index == TRIED:
            assert out.index is not None
            attempts = self.counts.attempts[out.index]
            text = f"{event.text}; stage {to!r} has had its {attempts} attempts"
            self._end(clock, events.Event(event.kind, events.ATTEMPTS, text), value, FAIL)
            return None
        before, after = self.runner, self.runners[index]
        if not handed:
            self.last[:] = self.torque
            before.leaving.evaluate()
        self.handed[_SAME] = before.stage.tracked == after.stage.tracked
        if self.estimation.on:
            self.estimation.end(before.stage, self.terms, self.wrench, summed=handed)
        unknown = self.estimation.missing(after.stage)
        if unknown:
            text = f"stage {to!r} cannot begin: {unknown}"
            self._end(clock, events.Event(events.LIMIT, "frame_not_felt", text), 0.0, "")
            return None
        self._note(clock, event, value, to)
        rests = before.rests(self.t)
        if event.kind == events.REACTION:
            rests[event.name] = RESTS
        self._begin(index, again=again)
        # What failed is not carried on: a law that presses too hard ends with the stage.
        carries = event.kind not in (events.FAIL_IF, events.REACTION)
        return Opening(clock, carries, rests)

    def open(self, opening: Opening) -> None:
        """The new stage's tick at t = 0: this one. What the old one made of it was not applied."""
        after, clock = self.runner, opening.clock
        self._enter(clock)
        after.rest(opening.rests)
        carried = after.carry() if opening.carries else 0.0
        self.torque[:] = self.applied
        noted = self.transitions[-1]
        fresh = self._evaluate(after)
        self.stage_ticks = 1
        event = self.outputs[0]
        if not fresh:
            self._hold(after, clock)
        noted.torque_step = max(map(abs, (self.torque - self.last).tolist()))
        noted.torque_carried = carried
        if event and self._is_limit(event):
            self._change(clock)
            return
        if fresh:
            self._commit(after)
        self.earlier[:] = self.applied
        self.predict()

    def _end(self, clock: float, event: events.Event, value: float, to: str) -> None:
        self.ended = to or FAIL
        self._note(clock, event, value, to)

    def _note(self, clock: float, event: events.Event, value: float, to: str) -> None:
        self.transitions.append(
            Transition(clock, self.stage.name, event.kind, event.name, event.text, value, to)
        )

    def _begin(self, index: int, *, again: bool = False) -> None:
        """Makes a stage the current one; `again` where it repeats itself."""
        enter(self.counts, index, again)
        self.index, self.runner = index, self.runners[index]
        self.stage_ticks, self.t = 0, 0.0
        self.now[2 + index] += 1
        begin_stage(self.grip, index)
        self.estimation.begin(self.runner.stage)

    def _enter(self, clock: float) -> None:
        """Enters the current stage from what is handed over, at run time `clock` [s]."""
        self.outputs[_CONDITIONING] = 1.0
        self.now[0], self.now[1] = 0.0, clock
        if self.runner.tick.groups:
            self._group()
        self.runner.enter(self.estimation.poses, self.applied, self.earlier)

    def _group(self) -> None:
        """Groups the instructions of what each tick evaluates."""
        self.terms.group()
        self.runner.group()

    def not_finite(self) -> str:
        """The name of a reference of the last tick that is not a number; empty if all are."""
        reference = not_finite(self.stage.plan.plans, self.named_outputs())
        if reference:
            return reference
        equations = self.named_outputs()["reaction_ref"]
        for name, value in zip(self.stage.equations, equations, strict=True):
            if name in self.stage.plan.spec.constraints and not np.isfinite(value):
                return f"{name!r}"
        return ""

    def named_outputs(self) -> dict[str, Vector]:
        """The last outputs by name."""
        context = self.stage.plan.context
        named = slices(fields_of(context.loaded.task, context.robot.n))
        return {name: self.outputs[where] for name, where in named.items()}


def payload_estimate(machine: Machine, task: Task, robot: RobotModel) -> PayloadEstimate | None:
    """The estimate of the payload that laws of a task adapt to; None where none does."""
    adapted = adaptation(task, machine.period)
    if adapted is None:
        return None
    return PayloadEstimate(
        adapted,
        robot,
        machine.terms,
        (machine.v, machine.wrench, machine.torque),
        machine.now[payload_place(task)],
        touches=task.robot.sensor.at == "contact",
    )
