"""Start postures with room to the limits, where the file leaves yaw or elbow free.

The start nearest home is kept unless a joint comes within `_LIMIT_MARGIN` of a limit along the
stages, or the arm close to singular. Then the solution whose joints keep farthest from their limits
is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.control.null_space import joint_units
from taskspec.program.context import Context
from taskspec.program.passage import End
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.program.stages.conditions import NEAR_SINGULAR
from taskspec.robot.inverse_kinematics import SOLVED, InverseKinematics, Target, turns_at
from taskspec.text.diagnostic import SpecError

Vector = NDArray[np.float64]

#: A joint that stays farther from its limits has room [rad; of a slide, times the arm's length].
_LIMIT_MARGIN = math.radians(10.0)
#: Yaws that are tried, and motions of the elbow along the null space [rad].
_YAWS = 8
_ELBOWS = (0.4, -0.4, 0.8, -0.8, 1.2, -1.2)
#: Ends of a stage that stop a run.
_STOPS = (End.JOINT, End.REACH)


def roomiest(
    plan: Callable[[], TaskPlan],
    start_at: Callable[[Vector], TaskPlan],
    stages: int | None = None,
) -> TaskPlan:
    """The plan of a task from the start nearest home, or from one with more room.

    Args:
        plan: from the start nearest home.
        start_at: from joint positions (n,).
        stages: so many of them, from the first on, are followed; None for all of them.
    """
    task = plan()
    if not _free(task.context):
        return task
    own = room(task, stages)
    if own is None:
        return plan()  # It could not be followed: what is wrong with it is for the rules to say.
    if own > _LIMIT_MARGIN:
        return task
    best, most = task, own
    for candidates in (_turned, _bent):
        for q in list(candidates(best.context)):
            other = start_at(q)
            found = room(other, stages)
            if found is not None and found > most:
                best, most = other, found
        if most > _LIMIT_MARGIN and candidates is _turned:
            break
    # A start that is no better in the end is no reason to leave the one nearest home.
    return best if most > max(own, 0.0) else task


def room(task: TaskPlan, most: int | None = None) -> float | None:
    """The least distance of a joint from its limits along the stages [rad].

    Zero or less where the arm comes to a limit, out of reach or close to singular, the less the
    earlier it does; None where its stages cannot be followed.

    Args:
        task: from a start.
        most: so many stages, from the first on, are followed; None for all of them.
    """
    least = math.inf
    stages = list(task.stages)[:most]
    try:
        followed = [task.follow(name) for name in stages]
    except (SpecError, ValueError, ArithmeticError):
        return None
    for i, stage in enumerate(followed):
        passage = stage.nominal.passage
        if passage is None or stage.law.solve == "qp":
            continue
        if passage.end in _STOPS:
            return float(i - len(stages)) - 1.0 / (1.0 + passage.last.time)
        least = min(least, _room_of(stage))
    return least


def _room_of(stage: StagePlan) -> float:
    robot, passage = stage.context.robot, stage.nominal.passage
    assert passage is not None
    if min(instant.pivot for instant in passage.instants) < NEAR_SINGULAR:
        return 0.0
    q = np.array([instant.q for instant in passage.instants])
    units = joint_units([turns_at(robot, i) for i in range(robot.n)])
    return float(np.min(np.minimum(q - robot.lower, robot.upper - q) / units))


def _free(context: Context) -> bool:
    """Whether a file leaves open how the arm takes its start."""
    robot = context.loaded.task.robot
    start = robot.start
    if start is None or (start.xyz is None and start.joints is None):
        return robot.grasp is not None
    return start.joints is None


def _turned(context: Context) -> Iterator[Vector]:
    """The start with the tool turned about the vertical, where the file does not say how."""
    start = context.loaded.task.robot.start
    if (start is not None and start.rpy is not None) or len(context.robot.axes) < len("xyz") * 2:
        return
    solver = InverseKinematics(context.robot)
    for k in range(1, _YAWS):
        turn = pin.rpy.rpyToMatrix(0.0, 0.0, 2 * math.pi * k / _YAWS)
        target = Target(context.start_p, turn @ context.start_R)
        q, missing = solver.descend(context.start, target)
        if missing <= SOLVED:
            yield q


def _bent(context: Context) -> Iterator[Vector]:
    """The start with the elbow elsewhere."""
    robot = context.robot
    J = robot.twin().resolved_jacobian(context.start)
    J = J[[a.row for a in robot.axes]]
    if robot.n <= len(robot.axes):
        return
    null = np.linalg.svd(J)[2][-1]
    solver = InverseKinematics(robot)
    turns = any(a.is_rotation for a in robot.axes)
    target = Target(context.start_p, context.start_R if turns else None)
    for shift in _ELBOWS:
        q, missing = solver.descend(context.start + shift * null, target)
        if missing <= SOLVED:
            yield q
