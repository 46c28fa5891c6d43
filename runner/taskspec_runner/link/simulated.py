"""The MuJoCo plant as a robot: the protocol's first implementation, in this process."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.execution.sensor_zero import SensorZero, sensor_zero
from taskspec.program.program import Program
from taskspec.program.world.holding import truly_holding
from taskspec.program.worlds import World, true_world
from taskspec_runner.errors import LinkError
from taskspec_runner.link.robot import RobotFacts, RobotLimits, Sample
from taskspec_runner.loop.sensing import Sensing
from taskspec_runner.plant.plant import Plant

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Inputs:
    """The inputs of a machine that a sensor writes."""

    q: Vector
    v: Vector
    wrench: Vector
    reactions: Vector
    sensor: SensorZero | None
    period: float


class SimulatedRobot:
    """A robot that is a task's plant; it waits for each answer.

    Attributes:
        facts, limits: as a robot has them.
    """

    def __init__(self, program: Program, world: World | None = None) -> None:
        """The plant of a program.

        Args:
            program: the compiled task.
            world: that the plant is; None for the true one.
        """
        context, task = program.context, program.context.loaded.task
        world = true_world(context) if world is None else world
        self.facts = RobotFacts.of(program, lock_step=True)
        self.limits = RobotLimits.of(context.robot)
        self._plant = Plant(context.robot, world.task, truly_holding(context, world.task))
        n, zero = context.robot.n, sensor_zero(task, task.robot.sensor, context.robot)
        wrench, reactions = np.zeros(6), np.zeros(len(task.reported))
        inputs = _Inputs(np.zeros(n), np.zeros(n), wrench, reactions, zero, context.period)
        self._inputs = inputs
        arm, views = self._plant.arm, self._plant.views
        self._sensing = Sensing(arm, views.equations, inputs, world.noise_seed)
        self._wrench = wrench if zero is None else zero.reading
        self._ticks = 0

    def read(self) -> Sample:
        """The sample of this instant."""
        self._sensing.read()
        measured, stamp = self._inputs, self._ticks * self._inputs.period
        parts = (measured.q, measured.v, self._wrench)
        q, v, wrench = (part.copy() for part in parts)
        return Sample(q, v, wrench, stamp, measured.reactions.copy())

    def write(self, command: Vector) -> None:
        """Holds what the joints are commanded (n,), as `facts` have it, for one period.

        Raises:
            LinkError: the simulation has diverged.
        """
        if self.facts.grips and self._plant.arm.handling is not None:
            command, self._plant.arm.handling.source[:] = command[:-1], command[-1]
        self._plant.step(command)
        self._ticks += 1
        alarm = self._plant.alarm() if self._plant.arm.diverged else None
        if alarm is not None:
            raise LinkError(*alarm)

    def stop(self, reason: str) -> None:
        """Nothing is left to be stopped: its time goes on with its answers."""
