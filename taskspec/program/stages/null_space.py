"""Goals in the null space of a redundant arm: those of a stage's law, with their numbers."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from taskspec.control import null_space
from taskspec.control.state import TaskState
from taskspec.geometry.axis import Axis
from taskspec.program.context import Context
from taskspec.robot import RobotModel
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.robot.model_terms import TermSymbols
from taskspec.spec import Law


def goals(law: Law, robot: RobotModel, axes: tuple[Axis, ...]) -> tuple[str, ...]:
    """The goals that a law follows with an arm whose task has these axes.

    Empty where there is no null space, and under the laws that leave it alone.
    """
    redundant = robot.n > len(axes)
    return law.null_space if redundant and law.control_law.holds_null_space else ()


def null_space_command(
    law: Law, context: Context, state: TaskState, world: TermSymbols, q: ca.SX, v: ca.SX
) -> ca.SX | None:
    """What the law wants in the null space; None where it wants nothing there.

    That is q''_p (n,), or q'_p (n,) under a law that commands velocities.

    Args:
        law: of the stage.
        context: of the task.
        state: the arm on the task axes.
        world: the tip's kinematics against the world.
        q, v: (n,) joint positions and velocities.
    """
    robot = context.robot
    wanted = goals(law, robot, state.axes)
    if not wanted:
        return None
    units = null_space.joint_units([turns_at(robot, i) for i in range(robot.n)])
    J_task = null_space.scale(state.J, state.axes, units)
    pulls: dict[str, Callable[[], ca.SX]] = {
        "posture": lambda: null_space.posture(q, ca.SX(ca.DM(context.posture))),
        "joint-limits": lambda: null_space.joint_limits(q, robot.lower, robot.upper, J_task, units),
        "manipulability": lambda: null_space.manipulability(world.J, robot.axes, J_task, units),
    }
    pull = sum((pulls[goal]() for goal in wanted[1:]), start=pulls[wanted[0]]())
    if law.control_law.commands == "velocity":
        return null_space.velocity(pull)
    return null_space.acceleration(pull, v)


def bounded(robot: RobotModel) -> bool:
    """Whether any joint has limits that the goal of that name could keep away from."""
    return bool(np.any(np.isfinite(robot.lower) & np.isfinite(robot.upper)))
