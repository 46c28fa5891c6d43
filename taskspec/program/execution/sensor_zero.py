"""From the sensor's reading to the wrench that the controller uses: weight, zero, axes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.robot import RobotModel
from taskspec.robot.rebuild import GRAVITY
from taskspec.spec import Sensor, Task

Vector = NDArray[np.float64]

_GRAVITY = np.array(GRAVITY)


class SensorZero:
    """What the controller takes off the readings of a sensor that is carried by the tool.

    At the wrist hangs the tool: its weight, as the file has the tool, is subtracted in the
    orientation of now. What is left is contact, the tool's inertia, and the sensor's bias, until a
    stage with `tare` has measured it.

    Attributes:
        reading: (6,) the newest one, in the tool's axes about the tip, by the environment [N, N m];
            written from outside.
        zero: (6,) subtracted from what is left, in the same axes.
    """

    def __init__(self, robot: RobotModel, *, weighs: bool) -> None:
        """For the tool of `robot`; with `weighs`, its weight is in the readings."""
        body = robot.model.body(robot.tip_body)
        self._mass = float(body.mass[0]) if weighs else 0.0
        self._lever = np.array(body.ipos)
        self.reading, self.zero = np.zeros(6), np.zeros(6)
        self._left: Vector = np.zeros(6)
        self._sum: Vector = np.zeros(6)
        self._count = 0

    def correct(self, R: Vector, wrench: Vector) -> None:
        """Writes the contact wrench into `wrench` (6,), world axes, for the tip's axes R (3, 3)."""
        self._left = self.reading - self.weight(R) if self._mass else self.reading.copy()
        wrench_left = self._left - self.zero
        wrench[:3] = R @ wrench_left[:3]
        wrench[3:] = R @ wrench_left[3:]

    def weight(self, R: Vector) -> Vector:
        """(6,) of the nominal tool about the tip, in the tool's axes R (3, 3) [N, N m]."""
        force = self._mass * (R.T @ _GRAVITY)
        return np.concatenate([force, np.cross(self._lever, force)])

    def begin(self) -> None:
        """Forgets what has been collected."""
        self._sum, self._count = np.zeros(6), 0

    def collect(self) -> None:
        """Takes the newest reading into the mean."""
        self._sum = self._sum + self._left
        self._count += 1

    def tare(self) -> None:
        """The mean of what has been collected is the zero from now on."""
        if self._count:
            self.zero = self._sum / self._count


def sensor_zero(task: Task, sensor: Sensor, robot: RobotModel) -> SensorZero | None:
    """What corrects the readings of an arm's sensor.

    Args:
        task: for what varies, and for stages that tare.
        sensor: as the file has it.
        robot: the arm.

    Returns:
        None where the sensor gives the contact wrench as it is.
    """
    varied = any(path.startswith("robot.sensor") for path in task.vary)
    if sensor == Sensor() and not varied and not any(s.tare for s in task.stages.values()):
        return None
    return SensorZero(robot, weighs=sensor.at == "wrist")
