"""Contact stiffness and damping of the world's objects, `rigid` included."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from taskspec.robot import RobotModel
from taskspec.spec import Shape, Task

#: `rigid` is a contact whose frequency is this fraction of 1/T_plant: as stiff as the plant's
#: steps resolve, two of them in the time constant that MuJoCo itself would allow.
_RIGID_FRACTION = 0.5


def contact_mass(robot: RobotModel) -> float:
    """Mean mass [kg] that a contact at the tool feels, as MuJoCo counts it (1/invweight0)."""
    body = robot.model.body(robot.tip_body).id
    return 1.0 / float(robot.model.body_invweight0[body, 0])


def rigid_stiffness(robot: RobotModel, plant_period: float) -> float:
    """The stiffness [N/m] that `rigid` stands for on this robot at this plant step [s]."""
    return contact_mass(robot) * (_RIGID_FRACTION / plant_period) ** 2


def stiffness_of(shape: Shape, robot: RobotModel, plant_period: float) -> float:
    """Contact stiffness [N/m] of an object."""
    if shape.stiffness == "rigid":
        return rigid_stiffness(robot, plant_period)
    return float(shape.stiffness)


def damping_of(shape: Shape, robot: RobotModel, plant_period: float) -> float:
    """Contact damping [N s/m]: as declared, or a tenth of critical for 1 kg; critical if rigid."""
    if shape.damping is not None:
        return shape.damping
    k = stiffness_of(shape, robot, plant_period)
    if shape.stiffness == "rigid":
        return 2 * math.sqrt(k * contact_mass(robot))
    return 0.1 * 2 * float(np.sqrt(k))


def believed_stiffness(task: Task, robot: RobotModel) -> Mapping[str, float]:
    """Contact stiffness [N/m] of every object, as the file states it."""
    period = 1.0 / task.control.plant_rate
    return {name: stiffness_of(shape, robot, period) for name, shape in task.world.items()}
