"""The plant that the loop steps: state, contact wrench and the simulator's own alarms."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec_runner.plant.equations import Equations
from taskspec_runner.plant.grasp import Grip
from taskspec_runner.plant.loose import LooseBodies, loose
from taskspec_runner.plant.mechanisms import Mechanisms
from taskspec_runner.plant.moving_base import MovingBases, moving
from taskspec_runner.plant.scene import Scene, build_scene
from taskspec_runner.plant.views import PlantViews
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
        q, v: (n,) views of the arm's true joint positions and velocities.
        views: what is true, tick by tick; the vectors are filled in place.
        wrench: (6,) of the last step, by the environment on the tool tip, world axes [N, N m].
        wrist: (6,) the same as a sensor between flange and tool feels it, with the tool's weight
            and inertia; None unless `robot.sensor` is at the wrist.
        diverged: the last step's contact force is beyond all bounds.
        sensor: the true one. tip_rotation: (9,) the tip's axes in the last step, row by row.
    """

    def __init__(
        self, robot: RobotModel, task: Task, start: Vector, views: PlantViews | None = None
    ) -> None:
        """Builds the plant at joint positions `start` (n,), at rest.

        `task` is the true one; `views` are vectors that the caller wants filled.
        """
        self.scene: Scene = build_scene(robot, task, start)
        model = self.model = self.scene.model
        data = self.data = mujoco.MjData(model)
        n = robot.pin.nv
        data.qpos[:n] = start
        self.q, self.v = data.qpos[:n], data.qvel[:n]
        self.views = views = PlantViews.new(task) if views is None else views
        self.wrench, self.object_forces = views.wrench, views.objects
        self.diverged = False
        self._arm = slice(0, n)
        self._control, self._sensors = data.ctrl, data.sensordata
        self._tip = data.body(robot.tip_body).xpos
        self.tip_rotation, self.sensor = data.body(robot.tip_body).xmat, task.robot.sensor
        self._substeps = round(task.control.plant_rate / task.control.rate)
        self._slices = self.scene.sensors
        self._last_time = data.time
        self._add_parts(robot, task, start)
        self._settle()
        self._read_state()
        self._read_forces()

    def _add_parts(self, robot: RobotModel, task: Task, start: Vector) -> None:
        """What the task's world has beyond shapes that stand still; None for what it has not."""
        model, data = self.model, self.data
        applied = self.views.equations
        self._equations = (
            Equations(model, data, robot, task, start, applied) if task.equations else None
        )
        self._mechanisms = Mechanisms(model, data, task.mechanisms) if task.mechanisms else None
        self._moving_bases = MovingBases(model, data, task) if moving(task) else None
        self._loose = LooseBodies(model, data, task) if loose(task) else None
        self._grip = Grip(model, data, task) if task.robot.grasp is not None else None
        self._wrist = Wrist(model, data, robot) if task.robot.sensor.at == "wrist" else None
        self.wrist = self._wrist.wrench if self._wrist is not None else None
        has_detents = self._mechanisms is not None and self._mechanisms.detents
        self._simple = self._equations is None and self._moving_bases is None and not has_detents
        self._untouched = self._equations is None and self._grip is None and self._wrist is None
        self._still = self._mechanisms is None and self._loose is None
        name = (task.robot.grasp or "").partition(".")[0]
        self._held_mechanism = _index(name, list(task.mechanisms))
        self._held_shape = _index(name, list(task.shapes))

    def _settle(self) -> None:
        """Finds the forces before the first step; an arm that feels its tool rests on brakes."""
        model, data = self.model, self.data
        if self._moving_bases is not None:
            self._moving_bases.drive()
        mujoco.mj_forward(model, data)
        braked = self._grip is not None or self._wrist is not None
        if braked:
            arm = self._arm
            data.qfrc_applied[arm] = data.qfrc_bias[arm] - data.qfrc_passive[arm]
        if not self._simple:
            self._apply()
        if braked or not self._simple:
            mujoco.mj_forward(model, data)
            data.qfrc_applied[:] = 0.0

    def _apply(self) -> None:
        """Adds the forces that depend on the pose of this instant."""
        if self._equations is not None:
            self._equations.apply()
        if self._mechanisms is not None:
            self._mechanisms.apply()

    def step(self, torque: Vector) -> None:
        """Holds joint torques (n,) [N m] for one control period."""
        if not self._still:
            self._read_state()
        self._control[:] = torque
        if self._simple:
            mujoco.mj_step(self.model, self.data, self._substeps)
        else:
            for _ in range(self._substeps):
                self._step_once()
        self._read_forces()

    def _step_once(self) -> None:
        model, data = self.model, self.data
        data.qfrc_applied[:] = 0.0
        if self._moving_bases is not None:
            self._moving_bases.drive()
        mujoco.mj_step1(model, data)
        self._apply()
        mujoco.mj_step2(model, data)

    def _read_state(self) -> None:
        """The world's state of this instant."""
        views = self.views
        if self._mechanisms is not None:
            self._mechanisms.read(views.mechanism_positions, views.mechanism_rates)
        if self._loose is not None:
            self._loose.read(views.loose)

    def _read_forces(self) -> None:
        """The forces of the last step."""
        self._read_contact()
        if self._untouched:
            return
        if self._equations is not None:
            self.wrench[:3] += self._equations.on_tip
        if self._grip is not None:
            self._read_grip(self._grip)
        if self._wrist is not None:
            self._wrist.read(self.wrench)
        self.diverged = not float(self.wrench[:3] @ self.wrench[:3]) < FORCE_BOUND**2

    def _read_grip(self, grip: Grip) -> None:
        grip.read()
        self.wrench += grip.wrench
        if self._held_mechanism is not None:
            self.views.mechanism_efforts[self._held_mechanism] = grip.effort
        elif self._held_shape is not None:
            self.object_forces[self._held_shape] = np.linalg.norm(grip.wrench[:3])

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
        velocity, momentum = np.zeros(self.model.nv), np.zeros(self.model.nv)
        velocity[self._arm] = self.v
        mujoco.mj_mulM(self.model, self.data, momentum, velocity)
        return 0.5 * float(velocity @ momentum)


def _index(name: str, names: list[str]) -> int | None:
    return names.index(name) if name in names else None
