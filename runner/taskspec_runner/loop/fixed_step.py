"""The fixed-step loop: sense, tick, guard, step, record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from taskspec.program import events
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.transition import END, Transition
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.bus import Bus

#: Squared joint torques, velocities and positions of a sane run stay far below this.
_HEALTHY = 1e12
#: Ticks between looks at the simulator's warning counters, which are slow to read.
_LOOK_EVERY = 20

DONE, FAILED, STOPPED = "done", "failed", "stopped"


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a run ended.

    Attributes:
        status: done (the task reached `end`), failed (it reached `fail`), stopped (a limit or a
            guard of the simulator).
        reason: short name: end, within, fail_if, attempts, or the limit or alarm.
        text: the same as a sentence.
        stage: in which it ended.
        clock: simulated time [s].
        ticks: control periods.
    """

    status: str
    reason: str
    text: str
    stage: str
    clock: float
    ticks: int


class TickSink(Protocol):
    """What takes every tick."""

    def add(self) -> None:
        """Takes the bus as it is now."""


#: Called now and then with the machine and the simulated time.
Progress = Callable[[Machine, float], None]


def run(
    machine: Machine,
    plant: Plant,
    bus: Bus,
    recorder: TickSink,
    period: float,
    progress: Progress | None = None,
    seed: int = 0,
) -> Outcome:
    """Runs a task to its end; the recorder holds every tick up to there.

    `seed` is that of everything random in the run: the noise of the sensor.
    """
    arm = plant.arm
    sensing = Sensing(arm, plant.views.equations, machine, seed)
    clock_slot, t_slot, stage_slot = (bus.slices[name].start for name in ("clock", "t", "stage"))
    array, torque = bus.array, machine.torque
    health = bus.slices["health"].start
    tick, read, step, add = machine.tick, sensing.read, plant.step, recorder.add
    read()
    machine.start()
    ticks, clock = 0, 0.0
    while True:
        read()
        event = tick(clock)
        array[clock_slot], array[t_slot], array[stage_slot] = clock, machine.t, machine.index
        if not array[health] < _HEALTHY:
            return _stopped("non_finite", _why_not_finite(machine), machine, clock, ticks)
        if event and machine.ended:
            if machine.transitions[-1].kind == events.LIMIT:
                # The tick that broke the limit belongs into the log.
                step(torque)
                add()
                ticks += 1
            return _ended(machine, clock, ticks)
        step(torque)
        add()
        ticks += 1
        clock = ticks * period
        if arm.diverged or ticks % _LOOK_EVERY == 0:
            alarm = plant.alarm()
            if alarm is not None:
                return _stopped(*alarm, machine, clock, ticks)
            if progress is not None:
                progress(machine, clock)


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


def _ended(machine: Machine, clock: float, ticks: int) -> Outcome:
    last = machine.transitions[-1]
    status = DONE if machine.ended == END else FAILED
    if last.kind == events.LIMIT:
        status = STOPPED
    reason = END if status == DONE else last.name
    return Outcome(status, reason, last.text, last.stage, clock, ticks)
