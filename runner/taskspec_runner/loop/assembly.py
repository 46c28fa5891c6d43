"""A compiled task with everything that runs it: bus, plant, machine and recorder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np

from taskspec.control.qp.dual import dual_solver
from taskspec.deferred_methods import dataclass
from taskspec.program.execution.machine import Machine
from taskspec.program.execution.observer import Observer
from taskspec.program.program import Program
from taskspec.program.world.holding import truly_holding
from taskspec.program.worlds import World, true_world
from taskspec.robot import RobotError
from taskspec_runner.errors import InputError
from taskspec_runner.loop.driven import Driven, Senses
from taskspec_runner.plant.plant import Plant
from taskspec_runner.record.bus import Bus
from taskspec_runner.record.log import Log
from taskspec_runner.record.recorder import Recorder

if TYPE_CHECKING:
    from taskspec_runner.loop.faults import Faults

P = TypeVar("P", bound=Driven, covariant=True)


@dataclass(frozen=True, slots=True)
class Assembly(Generic[P]):
    """The parts of a run.

    Attributes:
        program: the compiled task.
        world: what the plant is.
        bus: one tick's numbers.
        plant: writes into it.
        machine: reads from it and writes into it.
        sensing: gives the machine what is measured; None for the plant's own sensors.
        measured: whether the log is of what was measured, as nobody knows the truth.
        faults: between the two; None where the task has none.
    """

    program: Program
    world: World
    bus: Bus
    plant: P
    machine: Machine
    sensing: Senses | None = None
    measured: bool = False
    faults: Faults | None = None

    def recorder(self, log: Log | None) -> Recorder:
        """A recorder of the bus into a log; None for one that keeps nothing."""
        program = self.program
        robot = program.context.robot
        return Recorder(
            log, self.bus, robot, program.stages, self.world.task, measured=self.measured
        )


def assemble(
    program: Program,
    world: World | None = None,
    *,
    linked: bool = False,
    before: Assembly[Plant] | None = None,
) -> Assembly[Plant]:
    """Builds the plant at the start of a run, and a fresh machine, on one bus.

    Args:
        program: the compiled task.
        world: that the plant is; None for the one that the file says is true.
        linked: whether its ticks have a `link`, as `Bus` has it.
        before: of a run of the same program that is over; its machine and bus are taken, where that
            leaves nothing of it.

    Raises:
        InputError: what the robot holds is where it cannot hold it.
    """
    context = program.context
    world = true_world(context) if world is None else world
    again = before is not None and before.program is program and before.machine.renewable
    bus = before.bus if before and again else Bus(context.robot.n, world.task, linked=linked)
    bus.array[:] = 0.0
    try:
        start = truly_holding(context, world.task)
    except RobotError as error:
        raise InputError(error.message) from error
    plant = Plant(context.robot, world.task, start, bus.truth)
    if before and again:
        machine = before.machine
        machine.renew()
        # The plant has written its state into the bus, not what the machine measures.
    else:
        measured = (np.zeros(6), np.zeros(len(world.task.reported)))
        views = (bus.view("q"), bus.view("v"), *measured, bus.commanded, bus.outputs)
        machine = program.machine(views, own=dual_solver)
    if plant.arm.handling is not None:
        plant.arm.handling.source = np.asarray(machine.grip.command)
    faults = None
    if world.task.truth.faults:
        # Most tasks have none, and need nothing of them.
        from taskspec_runner.loop.faults import Faults

        faults = Faults(world.task, context.robot, machine, plant, bus, world.noise_seed)
    if not world.task.joints_exact:
        true = bus.view("true.q"), bus.view("true.v"), bus.true_outputs
        plant.observer = Observer(context.robot, machine, (plant.arm.q, plant.arm.v), true)
    return Assembly(program, world, bus, plant, machine, faults=faults)
