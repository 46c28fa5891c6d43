"""The fixed-step loop: sense, tick, guard, step, record."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program import events
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.transition import END, Transition
from taskspec.program.ports import HEALTHY
from taskspec_runner.errors import InputError, LinkError
from taskspec_runner.loop.closed_loop import LOOK_EVERY, ClosedLoop
from taskspec_runner.loop.driven import BlockSink, Driven, Senses, TickSink
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.loop.to_rest import Brought, bring_to_rest
from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.bus import Bus

if TYPE_CHECKING:
    from taskspec.native.code import Compiling
    from taskspec_runner.loop.faults import Faults
    from taskspec_runner.loop.hand import Hand
    from taskspec_runner.loop.native.loop import NativeLoop

Vector = NDArray[np.float64]

#: Loops by their names: machine code, its first tier alone, and Python.
NATIVE, INTERPRETED, PYTHON = "native", "interpreted", "python"
_LOOPS = (NATIVE, INTERPRETED, PYTHON)
#: A variable of the environment that names the loop of runs that do not name it.
LOOP = "TASKSPEC_LOOP"
#: Ticks of a run after which a thread compiles code of its own. That takes as long as some 200 000
#: ticks save by it beside the interpreter; the next run finds it.
_WORTH_COMPILING = 100_000
#: Ticks that machine code runs at most before Python sees to messages, progress and interrupts.
_AT_ONCE = 400
DONE, FAILED, STOPPED = "done", "failed", "stopped"
#: Of a log from elsewhere that does not show whether its task came to its end.
UNDECIDED = "undecided"


@dataclass(frozen=True, slots=True)
class Outcome:
    """The end of a run.

    Attributes:
        status: done (the task reached `end`), failed (it reached `fail`), stopped (a limit or a
            guard of the simulator).
        reason: short name: end, within, fail_if, attempts, or the limit or alarm.
        text: the same as a sentence.
        stage: in which it ended.
        clock: simulated time [s].
        ticks: control periods.
        loop: what ran the ticks on which nothing happens, `native` or `python`.
        why_python: why they were not run natively, empty where they were or Python was selected.
        lost: whether an alarm of the simulator ended it, so that there is nothing to be brought to
            rest.
        not_at_rest: why the arm was not brought to rest after it, or not to the end; empty if it
            was, or that was not wanted.
        undamped: joints, from 1 on, that were carried alone meanwhile.
    """

    status: str
    reason: str
    text: str
    stage: str
    clock: float
    ticks: int
    loop: str = PYTHON
    why_python: str = ""
    lost: bool = False
    not_at_rest: str = ""
    undamped: tuple[int, ...] = ()


#: Called now and then with the machine and the simulated time.
Progress = Callable[[Machine, float], None]


def loop_wanted(loop: str | None) -> str | None:
    """The loop that is wanted, by the caller or the environment.

    Raises:
        InputError: there is none of that name, or not here.
    """
    named = loop or os.environ.get(LOOP) or None
    if named not in (None, *_LOOPS):
        raise InputError(f"{LOOP} names {', '.join(_LOOPS[:-1])} or {_LOOPS[-1]}, not {named!r}")
    if named in (NATIVE, INTERPRETED):
        from taskspec.native.engine import missing

        why = missing()
        if why is not None:
            raise InputError(f"the native loop cannot be had: {why}")
    return named


def run(
    machine: Machine,
    plant: Driven,
    bus: Bus,
    recorder: TickSink,
    period: float,
    progress: Progress | None = None,
    seed: int = 0,
    loop: str | None = None,
    sensing: Senses | None = None,
    faults: Faults | None = None,
    hand: Hand | None = None,
    *,
    to_rest: bool = False,
) -> Outcome:
    """Runs a task to its end; the recorder holds every tick up to there.

    Args:
        machine, plant, bus: of the run, at its start.
        recorder: takes every tick; without a block, Python runs them all.
        period: of control [s].
        progress: called now and then.
        seed: of everything random in the run: the noise of the sensor.
        loop: `native` for code of the run's own, which is waited for; `interpreted` for the
            interpreter alone; `python`; None for the native loop where there is one, by the tier
            that is worth it.
        sensing: of a plant that is elsewhere, for which Python runs all ticks; None for the
            sensors of `plant`.
        faults: of the run, which Python runs then; None for none.
        hand: sets live params while it goes on; None where nobody does.
        to_rest: whether an arm whose run does not come to `end` is brought to rest after it, which
            the recorder takes, too.

    Raises:
        InputError: there is no native loop, and no other is wanted.
    """
    steps = Steps(machine, plant, bus, recorder, period, progress, seed, loop, sensing, faults)
    while steps.outcome is None:
        steps.advance(None if hand is None else hand.set(machine.live, steps.ticks))
    return steps.finish(to_rest=to_rest)


class Steps:
    """A run that whoever made it steps: some ticks, a look at machine and bus, some ticks more.

    In whatever numbers its ticks are run, they are those of `run`, bit for bit.

    Attributes:
        machine: of the run.
        ticks: that have been run and recorded.
        outcome: how it ended; None while it goes on.
    """

    def __init__(
        self,
        machine: Machine,
        plant: Driven,
        bus: Bus,
        recorder: TickSink,
        period: float,
        progress: Progress | None = None,
        seed: int = 0,
        loop: str | None = None,
        sensing: Senses | None = None,
        faults: Faults | None = None,
    ) -> None:
        """Takes the parts of a run at its start, as `run` has them; no tick is run yet."""
        if sensing is None:
            assert isinstance(plant, Plant)
            sensing = Sensing(plant.arm, plant.views.equations, machine, seed)
        self.machine, self.ticks = machine, 0
        self.outcome: Outcome | None = None
        self._closed = ClosedLoop(machine, plant, bus, sensing, recorder, faults)
        self._period, self._progress = period, progress or _unseen
        self._inner = _Native(self._closed, loop)
        self._started = False

    @property
    def clock(self) -> float:
        """Simulated time [s]: that of the tick that comes next."""
        return self.ticks * self._period

    def advance(self, most: int | None = None) -> int:
        """Runs up to `most` ticks, with None as many as there are; fewer where the run ends.

        Returns:
            How many have been recorded. `outcome` is set where the run has ended.
        """
        before = self.ticks
        if self.outcome is not None:
            return 0
        try:
            if not self._started:
                self._started = True
                self._closed.read()
                self.machine.start()
            self.outcome = self._run(math.inf if most is None else before + most)
        except LinkError as error:
            self.ticks = error.ticks
            self.outcome = _stopped(error.name, error.text, self.machine, self.clock, self.ticks)
        return self.ticks - before

    def finish(self, *, to_rest: bool = False) -> Outcome:
        """The outcome of a run that has ended; `to_rest` as in `run`."""
        outcome, inner = self.outcome, self._inner
        assert outcome is not None
        if to_rest and outcome.status != DONE:
            brought = _to_rest(self._closed, outcome, self._period)
            outcome = replace(outcome, not_at_rest=brought.why, undamped=brought.undamped)
        return replace(outcome, loop=inner.name, why_python=inner.why)

    def _run(self, end: float) -> Outcome | None:
        """The loop itself, up to `end` ticks; None where the run goes on then."""
        closed, period, progress, inner = self._closed, self._period, self._progress, self._inner
        machine, plant, bus = closed.machine, closed.plant, closed.bus
        clock_slot, t_slot, stage_slot = (bus.slices[k].start for k in ("clock", "t", "stage"))
        array, torque, arm = bus.array, machine.torque, plant.arm
        health = bus.slices["health"].start
        tick, read, step, add = machine.tick, closed.read, closed.step, closed.recorder.add
        ticks = self.ticks
        clock = ticks * period
        while ticks < end:
            # `inner` runs the ticks on which nothing happens, as far as it can.
            done = inner.run(ticks, end) if inner.runs else 0
            if done:
                self.ticks = ticks = ticks + done
                clock = ticks * period
                if inner.look:
                    alarm = plant.alarm()
                    if alarm is not None:
                        return _lost(*alarm, machine, clock, ticks)
                progress(machine, clock)
                if inner.goes_on:
                    continue
            if not inner.sensed:
                read()
            if not inner.made:
                tick(clock)
            array[clock_slot], array[t_slot], array[stage_slot] = clock, machine.t, machine.index
            if not array[health] < HEALTHY:
                return _stopped("non_finite", _why_not_finite(machine), machine, clock, ticks)
            if machine.ended:
                self.ticks += _last(closed)
                return _ended(machine, clock, self.ticks)
            step(torque)
            add()
            self.ticks = ticks = ticks + 1
            clock = ticks * period
            if arm.diverged or ticks % LOOK_EVERY == 0:
                alarm = plant.alarm()
                if alarm is not None:
                    return _lost(*alarm, machine, clock, ticks)
                progress(machine, clock)
        return None


def _last(closed: ClosedLoop) -> int:
    """Logs the tick that broke a limit, which belongs there; how many that are."""
    if closed.machine.transitions[-1].kind != events.LIMIT:
        return 0
    closed.step(closed.machine.torque)
    closed.machine.predict()
    closed.recorder.add()
    return 1


def _to_rest(closed: ClosedLoop, outcome: Outcome, period: float) -> Brought:
    """Brings the arm to rest after a run."""
    if closed.faults is not None:
        closed.faults.end()
    plant = closed.plant.release()
    if plant is None:
        return Brought("the robot does that itself", ())
    if not outcome.ticks:
        return Brought("it had not been moved", ())
    if outcome.lost:
        return Brought("the simulation had diverged", ())
    return bring_to_rest(closed, plant, outcome.ticks, period)


def _unseen(machine: Machine, clock: float) -> None:
    """Progress that is not shown."""


class _Native:
    """The native loop of a run, or why there is none.

    Attributes:
        why: why Python runs all ticks, as a sentence; empty where it does not, or is wanted to.
        used: whether machine code has run any.
        runs: whether it may run more.
        look: whether the plant's alarms are to be checked after what has been run.
        goes_on: whether the tick that follows is the native loop's own.
        sensed: whether the tick that follows has been sensed.
        made: whether the machine has made it, so that only its step and its record are left.
    """

    def __init__(self, closed: ClosedLoop, wanted: str | None) -> None:
        """For a run; `wanted` is a loop, or None for whichever there is."""
        self.why, self.used = "", False
        self.look = self.goes_on = self.sensed = self.made = False
        self._closed = closed
        self._wanted = wanted
        self._loop: NativeLoop | None = None
        self._sink = closed.recorder if isinstance(closed.recorder, BlockSink) else None
        self.runs = (
            wanted != PYTHON and self._sink is not None and isinstance(closed.sensing, Sensing)
        )
        if closed.faults is not None:
            self._stop("the faults of the task's truth are Python's")

    def _stop(self, why: str) -> None:
        """Has Python run the ticks; an InputError where the native loop is wanted."""
        if self._wanted in (NATIVE, INTERPRETED):
            raise InputError(f"the native loop cannot be had: {why}")
        self.why, self.runs = why, False

    @property
    def name(self) -> str:
        """Name of the loop."""
        return NATIVE if self.used else PYTHON

    def run(self, ticks: int, end: float) -> int:
        """Runs ticks after the first `ticks` of a run, at most up to `end`; how many there were."""
        # It stays so where `run` is not called any more.
        self.look = self.goes_on = self.sensed = self.made = False
        assert self._sink is not None
        # With llvmlite these take a tenth of a second to import.
        from taskspec.native.code import Compiling
        from taskspec.native.engine import EngineError
        from taskspec.native.expressions import UnsupportedOperationError
        from taskspec_runner.loop.native.loop import NativeLoop
        from taskspec_runner.plant.simulator import LayoutError

        try:
            compiling = Compiling.BESIDE if ticks >= _WORTH_COMPILING else Compiling.NOT_YET
            if self._wanted == NATIVE:
                compiling = Compiling.WAIT
            elif self._wanted == INTERPRETED:
                compiling = Compiling.NEVER
            if self._loop is None:
                self._loop = NativeLoop(self._closed, self._sink.block)
            done = self._code(self._loop, ticks, end, compiling)
            while self._loop.ends:
                done += self._code(self._loop, ticks + done, end, compiling)
        except (EngineError, UnsupportedOperationError, LayoutError) as error:
            self._stop(str(error))
            return 0
        self.look, self.made = self._loop.look, self._loop.made
        self.sensed = self._loop.sensed or self.made
        self.goes_on = not self.sensed
        return done

    def _code(self, loop: NativeLoop, ticks: int, end: float, compiling: Compiling) -> int:
        """Has machine code run ticks after the first ones, and the recorder take them."""
        assert self._sink is not None
        done = loop.run(ticks, int(min(self._sink.left, _AT_ONCE, end - ticks)), compiling)
        self._sink.advance(done)
        if done and not self.used:
            self.used = True
            self._sink.by_machine_code()
        return done


def _why_not_finite(machine: Machine) -> str:
    reference = machine.not_finite()
    when = f"{machine.t:.4g} s into stage {machine.stage.name!r}"
    if reference:
        return f"the reference of {reference} is not a finite number {when}"
    return (
        f"state or torque is no longer finite {when}: the controlled arm has diverged, or a "
        "reference has no rate or acceleration there"
    )


def _stopped(name: str, text: str, machine: Machine, clock: float, ticks: int) -> Outcome:
    machine.transitions.append(
        Transition(clock, machine.stage.name, events.LIMIT, name, text, 0.0, "")
    )
    return Outcome(STOPPED, name, text, machine.stage.name, clock, ticks)


def _lost(name: str, text: str, machine: Machine, clock: float, ticks: int) -> Outcome:
    return replace(_stopped(name, text, machine, clock, ticks), lost=True)


def _ended(machine: Machine, clock: float, ticks: int) -> Outcome:
    last = machine.transitions[-1]
    status = DONE if machine.ended == END else FAILED
    if last.kind == events.LIMIT:
        status = STOPPED
    reason = END if status == DONE else last.name
    return Outcome(status, reason, last.text, last.stage, clock, ticks)
