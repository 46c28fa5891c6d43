"""From the sensor's reading to the wrench that the controller uses: weight, zero, axes."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.faults import ENCODER
from taskspec.program.bound import Wiring
from taskspec.program.execution.payload_estimate import KEPT, PayloadEstimate
from taskspec.robot import RobotModel
from taskspec.robot.rebuild import GRAVITY
from taskspec.spec import Sensor, Task

Vector = NDArray[np.float64]

_GRAVITY = list(GRAVITY)


class SensorZero:
    """The correction of the readings of a sensor that the tool carries.

    At the wrist hangs the tool: its weight, as the file has the tool, is subtracted in the
    orientation of now. What is left is contact, the tool's inertia, and the sensor's bias, until a
    stage with `tare` has measured it. The weight of a payload that laws adapt to is subtracted as
    well, in the orientation of now and in that of the zero: what was estimated since then counts in
    the zero, too, so that it matters not which of the two comes first. The weight of what a gripper
    holds stays in the wrench: whoever reads it subtracts that (`ports.Inputs.contact`). So no zero
    has it.

    Attributes:
        reading: (6,) the newest one, in the tool's axes about the tip, by the environment [N, N m];
            written from outside.
        turned: (9,) the tip's axes of now, column after column; written by `correct`.
        left: (6,) of the reading without the weight, and without that of what is gripped; with a
            payload also (3,) gravity in these axes [m/s^2].
        zero: (6,) or (9,) subtracted from what is left, in the same axes.
        wrench: (6,) of the contact, world axes [N, N m].
        function: reading, axes, zero -> left, wrench.
        total: (6,) or (9,) sum of what has been left since a stage began.
        count: (1,) ticks of it.
    """

    def __init__(
        self,
        robot: RobotModel,
        *,
        weighs: bool,
        payload: PayloadEstimate | None = None,
        load: Vector | None = None,
    ) -> None:
        """For the tool of `robot`; with `weighs`, readings have its weight and the payload's.

        Args:
            load: (1,) mass that is gripped, as far as it is known [kg]; None where nothing is.
        """
        carries = weighs and payload is not None
        self._mass = robot.tool_body.mass if weighs else 0.0
        self._lever = robot.tool_body.lever
        size = 9 if carries else 6
        self.reading, self.zero, self.turned = np.zeros(6), np.zeros(size), np.zeros(9)
        self.left, self.wrench = np.zeros(size), np.zeros(6)
        self.total, self.count = np.zeros(size), np.zeros(1)
        wiring = Wiring()
        R = ca.reshape(wiring.reads("turned", self.turned), 3, 3)
        left = wiring.reads("reading", self.reading) - self.weight(R)
        zero = wiring.reads("zero", self.zero)
        contact, down = left - zero[:6], R.T @ ca.DM(_GRAVITY)
        if load is not None:
            left -= ca.vertcat(wiring.reads("load", load) * down, ca.SX.zeros(3))
        if carries:
            assert payload is not None
            adaptation = payload.adaptation
            known = adaptation.model(wiring.reads("payload", payload.memory)[:KEPT])
            contact -= adaptation.weight(known, down - zero[6:])
            left = ca.vertcat(left, down)
        wiring.writes(left, self.left)
        wiring.writes(ca.vertcat(R @ contact[:3], R @ contact[3:]), self.wrench)
        self.function = wiring.bound("zeroed")

    def correct(self, R: Vector, wrench: Vector) -> None:
        """Writes the contact wrench into `wrench` (6,), world axes, for the tip's axes R (3, 3)."""
        self.turned[:] = R.ravel(order="F")
        self.function.evaluate()
        wrench[:] = self.wrench

    def weight(self, R: ca.SX) -> ca.SX:
        """(6,) of the nominal tool about the tip, in the tool's axes R (3, 3) [N, N m]."""
        force = self._mass * (R.T @ ca.DM(_GRAVITY))
        return ca.vertcat(force, ca.cross(ca.DM(self._lever), force))

    def renew(self) -> None:
        """Makes it as it was before a run."""
        for array in (self.reading, self.zero, self.turned, self.left, self.wrench):
            array[:] = 0.0
        self.begin()

    def begin(self) -> None:
        """Forgets what has been collected."""
        self.total[:], self.count[:] = 0.0, 0.0

    def collect(self) -> None:
        """Takes the newest reading into the mean."""
        self.total += self.left
        self.count += 1.0

    def tare(self) -> None:
        """The mean of what has been collected is the zero from now on."""
        if self.count[0]:
            self.zero[:] = self.total / self.count


def sensor_zero(
    task: Task,
    sensor: Sensor,
    robot: RobotModel,
    payload: PayloadEstimate | None = None,
    load: Vector | None = None,
) -> SensorZero | None:
    """The correction of the readings of an arm's sensor.

    Args:
        task: for what varies, for faults, and for stages that tare.
        sensor: as the file has it.
        robot: the arm.
        payload: that laws adapt to; None for none.
        load: (1,) mass that is gripped [kg]; None in a task that grips nothing.

    Returns:
        None where the sensor gives the contact wrench as it is.
    """
    paths = (*task.vary, *task.truth.paths)
    varied = any(path.startswith("robot.sensor") for path in paths)
    # With what encoders show, a reading is turned otherwise than the tool truly is.
    coarse = task.robot.encoder is not None or any("robot.encoder" in path for path in paths)
    varied = varied or coarse or bool(task.truth.of(ENCODER))
    if sensor == Sensor() and not varied and not any(s.tare for s in task.stages.values()):
        return None
    return SensorZero(robot, weighs=sensor.at == "wrist", payload=payload, load=load)
