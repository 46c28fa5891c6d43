"""A robot as a run uses it: joint state and wrench come from it, commands go to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.execution.sensor_zero import sensor_zero
from taskspec.program.program import Program
from taskspec.robot import RobotModel
from taskspec.spec.gripper import REPORTED
from taskspec.spec.servo import PLURALS, TORQUE
from taskspec_runner.errors import InputError

Vector = NDArray[np.float64]

#: What a robot's wrench is: of the contact in world axes, or a reading in the tool's axes from
#: which weight and zero are still to be taken.
CONTACT, READING = "contact", "reading"
#: The extra of a state that has what live params are set to at the plant.
TARGET = "param_target"
#: Two rates are the same within this share.
_SAME_RATE = 1e-6


@dataclass(frozen=True, slots=True)
class RobotLimits:
    """Limits of a robot by joint.

    Attributes:
        torque: (n,) [N m, N].
        velocity: (n,) [rad/s, m/s].
        lower, upper: (n,) ends of its range [rad, m].
    """

    torque: tuple[float, ...]
    velocity: tuple[float, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]

    @classmethod
    def of(cls, robot: RobotModel) -> RobotLimits:
        """The limits of a model."""
        parts = (robot.torque_limit, robot.velocity_limit, robot.lower, robot.upper)
        return cls(*(tuple(map(float, part)) for part in parts))


@dataclass(frozen=True, slots=True)
class RobotFacts:
    """Facts that a robot reports before it moves.

    Attributes:
        name: of the robot.
        joints: names, in the order of all its vectors.
        period: from one sample to the next [s].
        wrench: `contact` or `reading`.
        reactions: names of the constraints on joints whose reactions it measures; last, of a robot
            with a gripper, what that reports (`spec.gripper.REPORTED`).
        lock_step: whether it waits for the answer to each sample; else its clock goes on.
        command: what its joints take: `torque`, `velocity` or `position`.
    """

    name: str
    joints: tuple[str, ...]
    period: float
    wrench: str = CONTACT
    reactions: tuple[str, ...] = ()
    lock_step: bool = False
    command: str = TORQUE

    @property
    def grips(self) -> bool:
        """Whether a last number of each command is what the jaws press with [N]."""
        return self.reactions[-len(REPORTED) :] == REPORTED

    @classmethod
    def of(cls, program: Program, *, lock_step: bool) -> RobotFacts:
        """The requirements of a task on its robot."""
        context = program.context
        task = context.loaded.task
        zero = sensor_zero(task, task.robot.sensor, context.robot)
        return cls(
            context.robot.name,
            tuple(context.robot.joint_names),
            context.period,
            CONTACT if zero is None else READING,
            task.reported,
            lock_step,
            context.drives.commands,
        )

    def check(self, robot: RobotFacts, where: str) -> None:
        """Finds out whether a robot is the one that these facts speak of.

        Args:
            robot: what it says of itself.
            where: it is, for the message.

        Raises:
            InputError: it is another one, takes other commands, or runs at another rate.
        """
        if len(robot.joints) != len(self.joints) or robot.joints != self.joints:
            raise InputError(
                f"the robot at {where} is {robot.name!r} with {_listed(robot.joints)}; the task is "
                f"for {self.name!r} with {_listed(self.joints)}; connect to that robot, or name "
                "this one as the task's 'robot.model'"
            )
        if robot.command != self.command:
            theirs, ours = PLURALS[robot.command], PLURALS[self.command]
            raise InputError(
                f"the robot at {where} takes joint {theirs}, the task commands joint {ours}; say "
                f"'robot: {{command: {robot.command}}}' in the task, or connect to a robot that "
                f"takes {ours}"
            )
        if abs(robot.period - self.period) > _SAME_RATE * self.period:
            rate, own = 1 / robot.period, 1 / self.period
            raise InputError(
                f"the robot at {where} runs at {rate:.6g} Hz, the task's control at "
                f"{own:.6g} Hz; run it with --set control.rate={rate:.6g}Hz"
            )
        if robot.wrench != self.wrench:
            raise InputError(
                f"the robot at {where} gives {_WRENCHES[robot.wrench]}, and the task's "
                f"'robot.sensor' declares {_WRENCHES[self.wrench]}; make the two the same"
            )
        if robot.reactions != self.reactions:
            raise InputError(
                f"beside joints and wrench, the robot at {where} measures "
                f"{_listed(robot.reactions)}, the task needs "
                f"{_listed(self.reactions)}; serve the same task file at both ends"
            )


_WRENCHES = {
    CONTACT: "the wrench of the contact in world axes",
    READING: "readings of a sensor on the tool",
}


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


@dataclass(slots=True, eq=False)
class Sample:
    """Measurements of a robot at an instant.

    Attributes:
        q, v: (n,) joint positions and velocities [rad or m], [rad/s or m/s].
        wrench: (6,) by the environment on the tool tip, as `RobotFacts.wrench` has it [N, N m].
        stamp: the robot's own time [s].
        reactions: (equations,) what the robot applies along each constraint's gradient [N, N m].
        last: whether the robot has ended, and takes no answer to it.
        params: what live params of the task are set to over there, by name [SI].
    """

    q: Vector
    v: Vector
    wrench: Vector
    stamp: float
    reactions: Vector = field(default_factory=lambda: np.zeros(0))
    last: bool = False
    params: Mapping[str, float] = field(default_factory=dict)


class CommandedRobot(Protocol):
    """What all robots have. `taskspec.robots` is the group of entry points that find one.

    Attributes:
        facts: what it says of itself; `facts.command` is what it takes.
        limits: what it can do.
    """

    facts: RobotFacts
    limits: RobotLimits

    def read(self) -> Sample:
        """Waits for the next sample. The first one is where the run starts: it is not answered.

        Raises:
            LinkError: there is none.
        """

    def write(self, command: Vector, /) -> None:
        """Answers the last sample with what each joint is commanded (n,).

        Of a task that grips (`facts.grips`) a last number is what each jaw is to press with [N].

        Raises:
            LinkError: it cannot be sent.
        """

    def stop(self, reason: str) -> None:
        """Ends: from now on the robot brings itself to rest. May be called twice."""


class TorqueRobot(CommandedRobot, Protocol):
    """A robot that takes torques. Without an answer it holds the last ones."""

    def write(self, torque: Vector, /) -> None:
        """Answers the last sample with joint torques (n,), gravity included [N m, N].

        Raises:
            LinkError: they cannot be sent.
        """


class VelocityRobot(CommandedRobot, Protocol):
    """A robot that takes velocities, which its own servo follows.

    Without an answer it holds the last ones for some samples, then slows down to rest: a velocity
    is held for ever by nobody.
    """

    def write(self, velocity: Vector, /) -> None:
        """Answers the last sample with joint velocities (n,) [rad/s, m/s].

        Raises:
            LinkError: they cannot be sent.
        """


class PositionRobot(CommandedRobot, Protocol):
    """A robot that takes positions, which its own servo follows. Without an answer it stays there.

    The first command is near the first sample's position, and each later one near the one before.
    """

    def write(self, position: Vector, /) -> None:
        """Answers the last sample with joint positions (n,) [rad, m].

        Raises:
            LinkError: they cannot be sent.
        """
