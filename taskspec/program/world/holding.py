"""The mechanism that the robot holds: the grip at the start, and errors of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from taskspec.program.errors import spec_error
from taskspec.program.world.frames import Posed, pose
from taskspec.program.world.mechanisms import MechanismModel, mechanism_models
from taskspec.robot import RobotError, RobotModel, solve_start
from taskspec.robot.inverse_kinematics import SOLVED, InverseKinematics, Target
from taskspec.spec import FILE, LoadedTask, Robot, Task
from taskspec.spec.equation import EquationObject
from taskspec.text.codes import register
from taskspec.text.diagnostic import SpecError
from taskspec.text.units import show

register(
    {
        "TS415": "a start away from the handle that the robot is to hold",
        "TS416": "a knob that the robot cannot turn",
    }
)

if TYPE_CHECKING:
    from taskspec.program.context import Context

Vector = NDArray[np.float64]

#: Farther than this from the handle the tip does not hold it [m].
_REACH = 1e-3


def grip_point(robot: Robot, task: Task, models: Mapping[str, MechanismModel]) -> Vector:
    """(3,) where the tip takes hold of what the robot's `grasp` names, world [m]."""
    assert robot.grasp is not None
    name = robot.grasp.removesuffix(".handle")
    if name in models:
        return models[name].grip
    return np.array(task.shapes[name].xyz, dtype=float)


def holding_start(
    loaded: LoadedTask, robot: Robot, model: RobotModel, models: Mapping[str, MechanismModel]
) -> Vector:
    """(n,) the configuration in which a run starts whose robot holds something.

    Where the start has no place, it is where the tip takes hold.

    Args:
        loaded: the task.
        robot: as the file has it.
        model: its models.
        models: of the mechanisms.

    Raises:
        SpecError: a given start is not at the handle, or nothing could turn what is held.
        RobotError: the arm does not get there.
    """
    start = robot.start
    name = (robot.grasp or "").removesuffix(".handle")
    if name in models and models[name].free and models[name].angular and not models[name].swings:
        raise spec_error(
            loaded,
            FILE.world[name].knob,
            "TS416",
            f"the knob of {name!r} is free and on its axis: the robot cannot turn it",
            "write knob: fixed, or place the handle off the axis",
        )
    point = grip_point(robot, loaded.task, models)
    if start is None or (start.xyz is None and start.joints is None):
        return _start_at(robot, model, point)
    q = solve_start(model, start.xyz, start.rpy, start.joints)
    if name in models:
        _check_at_handle(loaded, robot, model, q, point)
    return q


def truly_holding(context: Context, true: Task) -> Vector:
    """(n,) where a run starts whose robot holds what is really elsewhere: the hand has found it.

    The tool is to the handle as it is to the nominal one.

    Args:
        context: of the task, whose start it is near.
        true: the task with the world as it is.

    Raises:
        RobotError: the arm does not get there.
    """
    robot, nominal = context.loaded.task.robot, context.loaded.task
    name = (robot.grasp or "").removesuffix(".handle")
    if not name or nominal.world[name] == true.world[name]:
        return context.start
    R, R_true = (pose(_posed(task, name))[0] for task in (nominal, true))
    p, p_true = (grip_point(robot, task, mechanism_models(task)) for task in (nominal, true))
    turn = R_true @ R.T
    rotation = turn @ context.start_R if "rz" in context.robot.axes else None
    target = Target(p_true + turn @ (context.start_p - p), rotation)
    q, missing = InverseKinematics(context.robot).descend(context.start, target)
    if missing > SOLVED:
        raise RobotError(
            "TS412",
            f"{robot.grasp!r} is really where the arm cannot hold it",
            "mind what 'truth' and 'vary' say of it",
        )
    return q


def _posed(task: Task, name: str) -> Posed:
    found = task.world[name]
    assert not isinstance(found, EquationObject)
    return found


def _start_at(robot: Robot, model: RobotModel, point: Vector) -> Vector:
    rpy = robot.start.rpy if robot.start else None
    try:
        return solve_start(model, point.tolist(), rpy, None)
    except RobotError as error:
        message = f"{robot.grasp!r} is to be held from the start, and {error.message}"
        field = error.field if rpy is not None and "rpy" in error.field else ("grasp",)
        raise RobotError(error.code, message, error.hint, field) from error


def _check_at_handle(
    loaded: LoadedTask, robot: Robot, model: RobotModel, q: Vector, point: Vector
) -> None:
    distance = float(np.linalg.norm(model.twin().tip(q).translation - point))
    if distance > _REACH:
        raise _away(loaded, robot, distance)


def _away(loaded: LoadedTask, robot: Robot, distance: float) -> SpecError:
    return spec_error(
        loaded,
        FILE.robot.start,
        "TS415",
        f"the tool tip starts {show(distance, 'mm', 3)} away from {robot.grasp!r}, which it is to "
        "hold",
        "leave xyz out: the start is then found from the handle",
    )
