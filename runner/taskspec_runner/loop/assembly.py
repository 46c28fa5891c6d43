"""A compiled task with everything that runs it: bus, plant, machine and recorder."""

from __future__ import annotations

import numpy as np

from taskspec.control.qp.dual import dual_solver
from taskspec.deferred_methods import dataclass
from taskspec.program.execution.machine import Machine
from taskspec.program.program import Program
from taskspec.spec import Task
from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.log import Log
from taskspec_runner.record.recorder import Recorder


@dataclass(frozen=True, slots=True)
class Assembly:
    """What a run is made of.

    Attributes:
        program: the compiled task.
        task: whose world and robot are the true ones.
        bus: one tick's numbers.
        plant: writes into it.
        machine: reads from it and writes into it.
    """

    program: Program
    task: Task
    bus: Bus
    plant: Plant
    machine: Machine

    def recorder(self, log: Log | None) -> Recorder:
        """A recorder of the bus into a log; None for one that keeps nothing."""
        program = self.program
        return Recorder(log, self.bus, program.context.robot, program.stages, self.task)


def assemble(program: Program, truth: Task | None = None) -> Assembly:
    """Builds the plant at the start of a run, and a fresh machine, on one bus.

    Args:
        program: the compiled task, with the nominal world.
        truth: the task whose world and robot the plant has; None for the nominal one.
    """
    context = program.context
    task = context.loaded.task if truth is None else truth
    bus = Bus(context.robot.pin.nv, task)
    plant = Plant(context.robot, task, context.start, bus.truth)
    measured = (np.zeros(6), np.zeros(len(context.equations)))
    views = (bus.view("q"), bus.view("v"), *measured, bus.view("torque"), bus.outputs)
    return Assembly(program, task, bus, plant, program.machine(views, own=dual_solver))
