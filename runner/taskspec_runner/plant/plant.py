"""The plant that the loop steps: state, contact wrench and the simulator's own alarms."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec_runner.plant.scene import Scene, build_scene
from taskspec_runner.plant.wrist import Wrist

Vector = NDArray[np.float64]

#: No contact of a sane task exerts more [N].
FORCE_BOUND = 1e5
#: Nor does an arm hold more kinetic energy [J].
ENERGY_BOUND = 1e4


class Plant:
    """A robot in its world.

    Attributes:
        scene: the compiled scene. model, data: MuJoCo's.
        q, v: (n,) views of the true joint positions and velocities.
        wrench: (6,) of the last step, by the environment on the tool tip, world axes [N, N m].
        diverged: the last step's contact force is beyond all bounds.
        object_forces: (objects,) magnitude of the contact force with each object [N].
        wrist: (6,) of the last step at the tip, world axes: contact, weight and inertia of the tool
            together, what it exerts on the flange. None unless the sensor is there.
        tip_rotation: (9,) the tip's axes in that step, row by row.
        sensor: the true one.
    """

    def __init__(
        self,
        robot: RobotModel,
        task: Task,
        start: Vector,
        views: tuple[Vector, Vector] | None = None,
    ) -> None:
        """Builds the plant at joint positions `start` (n,), at rest.

        `views` are arrays for `wrench` and `object_forces` that the caller wants filled in place.
        """
        self.scene: Scene = build_scene(robot, task, start)
        self.model = self.scene.model
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = start
        mujoco.mj_forward(self.model, self.data)
        self.q, self.v = self.data.qpos, self.data.qvel
        self._control, self._sensors = self.data.ctrl, self.data.sensordata
        self._tip = self.data.body(robot.tip_body).xpos
        self._substeps = round(task.control.plant_rate / task.control.rate)
        own = (np.zeros(6), np.zeros(len(self.scene.objects)))
        self.wrench, self.object_forces = views or own
        self.diverged = False
        self.sensor = task.robot.sensor
        self.tip_rotation = self.data.body(robot.tip_body).xmat
        self.wrist = np.zeros(6) if self.sensor.at == "wrist" else None
        self._slices = self.scene.sensors
        self._last_time = self.data.time
        self._read_contact()
        self._wrist = Wrist(self.model, robot.tip_body) if self.sensor.at == "wrist" else None
        if self._wrist is not None and self.wrist is not None:
            self._wrist.at_rest(self.tip_rotation, self.wrench, self.wrist)

    def step(self, torque: Vector) -> None:
        """Holds joint torques (n,) [N m] for one control period."""
        self._control[:] = torque
        mujoco.mj_step(self.model, self.data, self._substeps)
        self._read_contact()
        if self._wrist is not None and self.wrist is not None:
            self._wrist.read(self.data, self.tip_rotation, self.wrist)

    def _read_contact(self) -> None:
        # Scalar arithmetic: at this size it costs a third of the same in array operations.
        fx = fy = fz = mx = my = mz = 0.0
        px, py, pz = self._tip.tolist()
        for number, where in enumerate(self._slices):
            x, y, z, a, b, c, ax, ay, az = self._sensors[where].tolist()
            self.object_forces[number] = (x * x + y * y + z * z) ** 0.5
            ax, ay, az = ax - px, ay - py, az - pz
            fx, fy, fz = fx + x, fy + y, fz + z
            mx += a + ay * z - az * y
            my += b + az * x - ax * z
            mz += c + ax * y - ay * x
        self.wrench[:] = fx, fy, fz, mx, my, mz
        self.diverged = not fx * fx + fy * fy + fz * fz < FORCE_BOUND**2

    def alarm(self) -> tuple[str, str] | None:
        """The simulator's own alarm as (name, text), if any."""
        number = self.data.warning.number
        if number.any():
            kind = mujoco.mjtWarning(int(np.argmax(number > 0))).name.removeprefix("mjWARN_")
            return "simulator_warning", f"MuJoCo warned of {kind} at {self.data.time:.4g} s"
        if not self.data.time > self._last_time:
            return "clock", f"the simulator's clock stands at {self.data.time:.4g} s"
        self._last_time = self.data.time
        if self.diverged:
            force = float(np.linalg.norm(self.wrench[:3]))
            return "force_bound", f"the contact exerts {force:.3g} N; the simulation has diverged"
        energy = self.kinetic_energy()
        if not energy < ENERGY_BOUND:
            return "energy_bound", f"the arm holds {energy:.3g} J; the simulation has diverged"
        return None

    def kinetic_energy(self) -> float:
        """Kinetic energy of the arm [J]."""
        momentum = np.zeros(self.model.nv)
        mujoco.mj_mulM(self.model, self.data, momentum, self.v)
        return 0.5 * float(self.v @ momentum)
