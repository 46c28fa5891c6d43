"""The closed loop of a task run ahead: its compiled stages, its sensor, and a plain plant.

What is told of a stage about an equilibrium leaves out what a task does between equilibria: a
mechanism that turns under the arm, a touch that lifts off again, a reference that is handed over.
A rehearsal has all of that, tick by tick, without the sensor's noise and without the simulator.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.plain_plant import PlainPlant
from taskspec.program import events
from taskspec.program.bound import Wiring
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.sensor_zero import SensorZero
from taskspec.program.execution.transition import END
from taskspec.program.plan import TaskPlan
from taskspec.program.ports import fields, slices
from taskspec.program.program import Program, compiled
from taskspec.program.sensor import SensorModel
from taskspec.program.signals import UnknownSignalError
from taskspec.text.diagnostic import SpecError

Vector = NDArray[np.float64]

#: Squared joint torques, velocities and positions of a sane run stay far below this.
_HEALTHY = 1e12
#: A task that nothing bounds is not rehearsed any longer [ticks].
_MOST_TICKS = 14000
#: Rows for which there is room at first.
_AT_FIRST = 2048


@dataclass(frozen=True, slots=True)
class Rehearsal:
    """How a task is foreseen to go, tick by tick.

    Attributes:
        status: `done`, `failed`, `stopped`, or `open` where it was broken off.
        reason: the limit or the guard that ended it.
        text: the same as a sentence.
        stage: in which it ended.
        names: of the stages.
        index: (k,) number of the stage of each tick.
        times: (k,) since that began [s].
        outputs: (k, size) the numbers of `ports.fields`.
        v: (k, n) rates of the joints as the tick began.
        torque: (k, n) that was commanded [N m].
        wrench: (k, 6) by the environment on the tip at the tick's end, world axes [N, N m].
        held: (k, 2) coordinate of the held mechanism, and its rate.
        effort: (k,) what the robot applies to that [N m, N].
        reactions: (k, equations) what it applies along each equation [N, N m].
        strays: whether a stage failed, and another than the next one followed.
    """

    status: str
    reason: str
    text: str
    stage: str
    names: tuple[str, ...]
    index: NDArray[np.int64]
    times: Vector
    outputs: Vector
    v: Vector
    torque: Vector
    wrench: Vector
    held: Vector
    effort: Vector
    reactions: Vector
    strays: bool

    def field(self, name: str) -> Vector:
        """(k, length) an output, by its name."""
        return self.outputs[:, slices(fields(self.reactions.shape[1]))[name]]

    def ticks(self, stage: str) -> Vector:
        """(k,) whether each tick is of a stage."""
        return np.asarray(self.index == self.names.index(stage))


def fits(task: TaskPlan) -> bool:
    """Whether the plain plant has all that the world of a task has."""
    context, spec = task.context, task.context.loaded.task
    loose = any(shape.gives_way for shape in spec.shapes.values())
    grasps_mechanism = spec.robot.grasp is None or bool(context.held)
    return grasps_mechanism and not loose


def rehearsal_of(task: TaskPlan, last: str) -> Rehearsal | None:
    """A task run ahead; None where it cannot be.

    Args:
        task: the plan.
        last: stage with which it ends; empty for none at all.
    """
    if not last or not fits(task):
        return None
    try:
        found = rehearse(Program(task, compiled(task, last)))
        if found.status == "done" and found.strays and last != [*task.stages][-1]:
            found = rehearse(Program(task, compiled(task)))
    except (UnknownSignalError, SpecError):
        return None
    return found


def rehearse(program: Program) -> Rehearsal:
    """Runs a compiled task ahead, in the world of its file."""
    context = program.context
    machine = program.machine()
    plant = PlainPlant(context, machine.terms, machine.torque)
    sensor = None if machine.sensor is None else _Sensor(program, plant, machine.sensor)
    kept = _Kept(machine, plant)
    status, reason, text, clock, ticks = "open", "", "", 0.0, 0
    most = _MOST_TICKS
    health = slices(fields(len(context.equations)))["health"].start

    def sense() -> None:
        machine.q[:], machine.v[:] = plant.q, plant.v
        machine.reactions[:] = plant.reactions
        if sensor is None:
            machine.wrench[:] = plant.wrench
        else:
            sensor.read()

    sense()
    machine.start()
    while ticks < most:
        sense()
        event = machine.tick(clock)
        if not machine.outputs[health] < _HEALTHY:
            status, reason, text = "stopped", "non_finite", "the loop has diverged"
            break
        over = bool(event) and bool(machine.ended)
        if over:
            last = machine.transitions[-1]
            status = "done" if machine.ended == END else "failed"
            status = "stopped" if last.kind == events.LIMIT else status
            reason, text = last.name, last.text
            if status != "stopped":
                break
        if sensor is not None:
            sensor.turn(machine.terms.rotation)
        plant.step(clock)
        kept.add()
        if over:
            break
        ticks += 1
        clock = ticks * machine.period
    names = tuple(stage.name for stage in program.stages)
    return kept.made(status, reason, text, names)


class _Kept:
    """Rows of the ticks, in memory that grows by doubling."""

    def __init__(self, machine: Machine, plant: PlainPlant) -> None:
        self._parts = (machine.outputs, machine.v, machine.torque, plant.wrench)
        self._rest = (plant.held, plant.effort, plant.reactions)
        self._machine, self._count = machine, 0
        every = (*self._parts, *self._rest)
        self._rows = [np.empty((_AT_FIRST, len(each))) for each in every]
        self._numbers = np.empty((_AT_FIRST, 2))
        self._every = every

    def add(self) -> None:
        """Takes the tick that has been."""
        i = self._count
        if i == len(self._numbers):
            self._rows = [np.vstack([rows, np.empty_like(rows)]) for rows in self._rows]
            self._numbers = np.vstack([self._numbers, np.empty_like(self._numbers)])
        for rows, array in zip(self._rows, self._every, strict=True):
            rows[i] = array
        self._numbers[i] = self._machine.index, self._machine.t
        self._count = i + 1

    def made(self, status: str, reason: str, text: str, names: tuple[str, ...]) -> Rehearsal:
        """All of them."""
        machine = self._machine
        stage = machine.transitions[-1].stage if machine.ended else machine.stage.name
        strays = any(not each.good for each in machine.transitions)
        n = self._count
        outputs, v, torque, wrench, held, effort, reactions = (rows[:n] for rows in self._rows)
        index, times = self._numbers[:n, 0].astype(int), self._numbers[:n, 1]
        return Rehearsal(
            status, reason, text, stage, names, index, times, outputs, v, torque, wrench, held,
            effort[:, 0], reactions, strays,
        )  # fmt: skip


class _Sensor:
    """The force sensor of the run, without its noise."""

    def __init__(self, program: Program, plant: PlainPlant, zero: SensorZero) -> None:
        context = program.context
        declared = context.loaded.task.robot.sensor
        model = SensorModel.of(declared, context.period)
        self._zero, self._hold, self._ticks = zero, model.hold_ticks, 0
        self._memory, self._kept = np.zeros(6 * model.order), np.zeros(6 * model.order)
        self._samples, self._turned = np.zeros(1), context.start_R.ravel(order="F").copy()
        wiring = Wiring()
        felt, turned = wiring.reads("felt", plant.wrist), wiring.reads("turned", self._turned)
        R = ca.reshape(turned, 3, 3)
        own = ca.vertcat(R.T @ felt[:3], R.T @ felt[3:]) + ca.DM(list(declared.bias))
        memory = ca.reshape(wiring.reads("memory", self._memory), 6, model.order)
        kept, reading = model.update(memory, own, wiring.reads("samples", self._samples))
        wiring.writes(reading, zero.reading)
        wiring.writes(ca.vec(kept), self._kept)
        self._function = wiring.bound("sensor")
        if plant.wrist is not plant.wrench:
            # As the run begins it feels the weight of the tool.
            weight = ca.evalf(zero.weight(ca.SX(ca.DM(context.start_R))))
            at_start = np.array(weight).ravel()
            plant.wrist[:3] = context.start_R @ at_start[:3]
            plant.wrist[3:] = context.start_R @ at_start[3:]
        R0 = context.start_R
        rest = np.concatenate([R0.T @ plant.wrist[:3], R0.T @ plant.wrist[3:]])
        rest = rest + np.array(list(declared.bias))
        self._memory[:] = np.tile(rest, model.order)

    def read(self) -> None:
        """One tick."""
        self._samples[0] = float(self._ticks % self._hold == 0)
        self._ticks += 1
        self._function.evaluate()
        self._memory[:] = self._kept

    def turn(self, R: Vector) -> None:
        """Takes the axes of the tip (9,), column after column, of the step that comes."""
        self._turned[:] = R
