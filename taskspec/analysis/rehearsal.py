"""The closed loop of a task run ahead: its compiled stages, its sensor, and a plain plant.

A look at a stage about an equilibrium leaves out what a task does between equilibria: a
mechanism that turns under the arm, a touch that lifts off again, a reference that is handed over.
A rehearsal has all of that, tick by tick, with the sensor's noise and without the simulator.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.loose_bodies import poses
from taskspec.analysis.plain_plant import PlainPlant
from taskspec.program import events
from taskspec.program.execution.force_sensor import ForceSensor
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.transition import END
from taskspec.program.limits.resolution import Resolution
from taskspec.program.plan import TaskPlan
from taskspec.program.ports import fields, slices
from taskspec.program.program import Program, compiled
from taskspec.program.signals import UnknownSignalError
from taskspec.program.stages.stage import CompiledStage
from taskspec.robot import RobotError
from taskspec.text.diagnostic import SpecError

Vector = NDArray[np.float64]

#: Squared joint torques, velocities and positions of a sane run stay far below this.
_HEALTHY = 1e12
#: A task that nothing bounds is not rehearsed any longer [ticks].
_MOST_TICKS = 24000
#: Rows for which there is room at first.
_AT_FIRST = 2048


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """How a task is predicted to go, tick by tick.

    Attributes:
        status: `done`, `failed`, `stopped`, or `open` where it was broken off.
        reason: the limit or the guard that ended it, or `attempts`.
        cause: the limit or the guard that called for one attempt too many, else the same.
        text: the same as a sentence.
        stage: in which it ended.
        names: of the stages.
        resolutions: of each the program that keeps its limits; None without one.
        index: (k,) number of the stage of each tick.
        times: (k,) since that began [s].
        outputs: (k, size) the numbers of `ports.fields`.
        v: (k, n) rates of the joints as the tick began.
        torque: (k, n) that was commanded [N m].
        wrench: (k, 6) by the environment on the tip at the tick's end, world axes [N, N m].
        mechanisms: (k, 2 mechanisms) of each its coordinate and its rate, in the order of
            `coordinates`.
        bodies: (k, 7 bodies) of each loose body position [m] and quaternion (w x y z), world.
        effort: (k,) what the robot applies to that [N m, N].
        reactions: (k, equations) what it applies along each equation [N, N m].
    """

    status: str
    reason: str
    cause: str
    text: str
    stage: str
    names: tuple[str, ...]
    resolutions: tuple[Resolution | None, ...]
    index: NDArray[np.int64]
    times: Vector
    outputs: Vector
    v: Vector
    torque: Vector
    wrench: Vector
    mechanisms: Vector
    bodies: Vector
    effort: Vector
    reactions: Vector

    def field(self, name: str) -> Vector:
        """(k, length) an output, by its name."""
        return self.outputs[:, slices(fields(self.reactions.shape[1]))[name]]

    def ticks(self, stage: str) -> Vector:
        """(k,) whether each tick is of a stage."""
        return np.asarray(self.index == self.names.index(stage))


def rehearsal_of(task: TaskPlan) -> Rehearsal | None:
    """A task run ahead to its end; None where it cannot be."""
    try:
        return rehearse(Program(task, compiled(task)))
    except (UnknownSignalError, SpecError, RobotError):
        return None


def rehearse(program: Program) -> Rehearsal:
    """Runs a compiled task ahead, in the true world of its file.

    Raises:
        RobotError: what the robot holds is where it cannot hold it.
    """
    context = program.context
    n, equations = context.robot.pin.nv, len(context.equations)
    numbers = np.zeros(program.output_size + 2 * n)
    outputs, v, torque = np.split(numbers, [program.output_size, program.output_size + n])
    machine = program.machine((np.zeros(n), v, np.zeros(6), np.zeros(equations), torque, outputs))
    machine.groups = False
    plant = PlainPlant(context, machine.terms, machine.torque)
    sensor = None
    if machine.sensor is not None:
        declared = context.loaded.true_task.robot.sensor
        wrench = plant.wrench if plant.wrist is None else plant.wrist
        sensor = ForceSensor(declared, wrench, plant.tip_rotation, machine.sensor, machine.period)
    kept = _Kept(machine, numbers, plant)
    measured = [(machine.q, plant.q), (machine.v, plant.v)]
    if equations:
        measured.append((machine.reactions, plant.reactions))
    if sensor is None:
        measured.append((machine.wrench, plant.wrench))
    status, reason, cause, text, clock, ticks = "open", "", "", "", 0.0, 0
    health = slices(fields(equations))["health"].start

    def sense() -> None:
        for told, true in measured:
            told[:] = true
        if sensor is not None:
            sensor.read()

    sense()
    machine.start()
    while ticks < _MOST_TICKS:
        sense()
        event = machine.tick(clock)
        if not outputs[health] < _HEALTHY:
            status, reason, text = "stopped", "non_finite", "the loop has diverged"
            break
        over = bool(event) and bool(machine.ended)
        if over:
            status, reason, cause, text = _ending(machine, program.stages, int(event))
            if status != "stopped":
                break
        plant.step(clock)
        kept.add()
        if over:
            break
        ticks += 1
        clock = ticks * machine.period
    return kept.made(status, reason, cause or reason, text, program.stages)


def _ending(
    machine: Machine, stages: Sequence[CompiledStage], event: int
) -> tuple[str, str, str, str]:
    """Status, reason, cause and text of a run that has ended, see `Rehearsal`."""
    last = machine.transitions[-1]
    status = "done" if machine.ended == END else "failed"
    if last.kind == events.LIMIT:
        status = "stopped"
    cause = last.name
    if cause == events.ATTEMPTS:
        cause = stages[machine.index].events[event - 1].name
    return status, last.name, cause, last.text


class _Kept:
    """Rows of the ticks, in memory that grows by doubling."""

    def __init__(self, machine: Machine, numbers: Vector, plant: PlainPlant) -> None:
        """Of a machine whose outputs, rates and torques are `numbers`, and of a plant."""
        self._machine, self._plant, self._now = machine, plant, (numbers, plant.numbers)
        self._count = 0
        self._rows = [np.empty((_AT_FIRST, len(each))) for each in self._now]
        self._index, self._times = np.empty(_AT_FIRST, dtype=int), np.empty(_AT_FIRST)

    def add(self) -> None:
        """Takes the tick that has been."""
        i, machine = self._count, self._machine
        if i == len(self._index):
            self._rows = [np.vstack([rows, np.empty_like(rows)]) for rows in self._rows]
            self._index = np.concatenate([self._index, np.empty_like(self._index)])
            self._times = np.concatenate([self._times, np.empty_like(self._times)])
        for rows, now in zip(self._rows, self._now, strict=True):
            rows[i] = now
        self._index[i], self._times[i] = machine.index, machine.t
        self._count = i + 1

    def made(
        self, status: str, reason: str, cause: str, text: str, stages: Sequence[CompiledStage]
    ) -> Rehearsal:
        """All of them."""
        machine, n = self._machine, self._count
        stage = machine.transitions[-1].stage if machine.ended else machine.stage.name
        numbers, plant = (rows[:n] for rows in self._rows)
        outputs, v, torque = _split(numbers, (machine.outputs, machine.v, machine.torque))
        wrench, mechanisms, effort, reactions, bodies = _split(plant, self._plant.parts)
        names = tuple(each.name for each in stages)
        resolutions = tuple(each.resolution for each in stages)
        return Rehearsal(
            status, reason, cause, text, stage, names, resolutions,
            self._index[:n], self._times[:n], outputs, v, torque,
            wrench, mechanisms, poses(bodies), effort[:, 0], reactions,
        )  # fmt: skip


def _split(rows: Vector, arrays: Sequence[Vector]) -> list[Vector]:
    """Columns (k, size) of each of some arrays that rows have one after the other."""
    ends = np.cumsum([len(array) for array in arrays])
    return np.split(rows, ends[:-1], axis=1)
