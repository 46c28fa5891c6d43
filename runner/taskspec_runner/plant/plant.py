"""The plant that the loop steps: its arm, the world around it, and the simulator's own alarms."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec_runner.plant.arm import SceneArm
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


class PlantArm:
    """An arm of a plant: its state, what drives it, and the forces on its tool.

    Attributes:
        q: (n,) view of the true joint positions.
        v: (n,) view of the true joint velocities.
        torque: (n,) view of what the motors are told to exert [N m, N].
        velocities: where the joints are among the plant's degrees of freedom.
        wrench: (6,) of the last step, by the environment on the tool tip, world axes [N, N m].
        object_forces: (shapes,) magnitude of the contact force with each shape [N].
        wrist: (6,) the wrench as a sensor between flange and tool feels it, with the tool's weight
            and inertia; None unless the sensor is at the wrist.
        sensor: the true one.
        tip_rotation: (9,) the tip's axes in the last step, row by row.
        rests: whether it rests on brakes before the first step, as it feels its tool.
        diverged: the last step's contact force is beyond all bounds.
    """

    def __init__(self, scene: Scene, data: mujoco.MjData, task: Task, views: PlantViews) -> None:
        """The arm of a scene; `views` take the forces on its tool."""
        arm, model = scene.arm, scene.model
        places = arm.places(model)
        self.q, self.v = data.qpos[places.positions], data.qvel[places.velocities]
        self.torque, self.velocities = data.ctrl[places.motors], places.velocities
        self.wrench, self.object_forces = views.wrench, views.objects
        self.sensor = arm.declared.sensor
        self.tip_rotation = data.xmat[places.tip]
        self.diverged = False
        self._model, self._data, self._views = model, data, views
        self._tip = data.xpos[places.tip]
        self._contacts, self._sensors = data.sensordata, scene.sensors
        self.equations = (
            Equations(model, data, arm, task, views.equations) if task.equations else None
        )
        self._grip = Grip(model, data, arm, task) if arm.held else None
        self._wrist = Wrist(model, data, arm) if self.sensor.at == "wrist" else None
        self.wrist = self._wrist.wrench if self._wrist is not None else None
        self.rests = self._grip is not None or self._wrist is not None
        self._untouched = self.equations is None and not self.rests
        self._held_mechanism = _index(arm.held, list(task.mechanisms))
        self._held_shape = _index(arm.held, list(task.shapes))

    def read_forces(self) -> None:
        """Reads the forces of the last step."""
        self._read_contact()
        if self._untouched:
            return
        if self.equations is not None:
            self.wrench[:3] += self.equations.on_tip
        if self._grip is not None:
            self._read_grip(self._grip)
        if self._wrist is not None:
            self._wrist.read(self.wrench)
        self.diverged = not float(self.wrench[:3] @ self.wrench[:3]) < FORCE_BOUND**2

    def _read_grip(self, grip: Grip) -> None:
        grip.read()
        self.wrench += grip.wrench
        if self._held_mechanism is not None:
            self._views.mechanism_efforts[self._held_mechanism] = grip.effort
        elif self._held_shape is not None:
            self.object_forces[self._held_shape] = np.linalg.norm(grip.wrench[:3])

    def _read_contact(self) -> None:
        # Scalar arithmetic: at this size it costs a third of the same in array operations.
        fx = fy = fz = mx = my = mz = 0.0
        px, py, pz = self._tip.tolist()
        for number, where in enumerate(self._sensors):
            x, y, z, a, b, c, ax, ay, az = self._contacts[where].tolist()
            self.object_forces[number] = (x * x + y * y + z * z) ** 0.5
            ax, ay, az = ax - px, ay - py, az - pz
            fx, fy, fz = fx + x, fy + y, fz + z
            mx += a + ay * z - az * y
            my += b + az * x - ax * z
            mz += c + ax * y - ay * x
        self.wrench[:] = fx, fy, fz, mx, my, mz
        self.diverged = not fx * fx + fy * fy + fz * fz < FORCE_BOUND**2

    def kinetic_energy(self) -> float:
        """Kinetic energy of the arm [J]."""
        velocity, momentum = np.zeros(self._model.nv), np.zeros(self._model.nv)
        velocity[self.velocities] = self.v
        mujoco.mj_mulM(self._model, self._data, momentum, velocity)
        return 0.5 * float(velocity @ momentum)


class Plant:
    """A robot in its world.

    Attributes:
        scene: the compiled scene.
        model: MuJoCo's.
        data: MuJoCo's.
        views: what is true, tick by tick; the vectors are filled in place.
        arm: the one that it steps.
    """

    def __init__(
        self, robot: RobotModel, task: Task, start: Vector, views: PlantViews | None = None
    ) -> None:
        """Builds the plant at joint positions `start` (n,), at rest.

        `task` is the true one; `views` are vectors that the caller wants filled.
        """
        self.scene: Scene = build_scene(SceneArm(robot, task.robot, start), task)
        model = self.model = self.scene.model
        data = self.data = mujoco.MjData(model)
        self.views = views = PlantViews.new(task) if views is None else views
        arm = self.arm = PlantArm(self.scene, data, task, views)
        arm.q[:] = start
        self._substeps = round(task.control.plant_rate / task.control.rate)
        self._last_time = data.time
        self._mechanisms = Mechanisms(model, data, task.mechanisms) if task.mechanisms else None
        self._moving_bases = MovingBases(model, data, task) if moving(task) else None
        self._loose = LooseBodies(model, data, task) if loose(task) else None
        has_detents = self._mechanisms is not None and self._mechanisms.detents
        self._simple = arm.equations is None and self._moving_bases is None and not has_detents
        self._still = self._mechanisms is None and self._loose is None
        self._settle()
        self._read_state()
        arm.read_forces()

    def _settle(self) -> None:
        """Finds the forces before the first step; an arm that feels its tool rests on brakes."""
        model, data, arm = self.model, self.data, self.arm
        if self._moving_bases is not None:
            self._moving_bases.drive()
        mujoco.mj_forward(model, data)
        if arm.rests:
            joints = arm.velocities
            data.qfrc_applied[joints] = data.qfrc_bias[joints] - data.qfrc_passive[joints]
        if not self._simple:
            self._apply()
        if arm.rests or not self._simple:
            mujoco.mj_forward(model, data)
            data.qfrc_applied[:] = 0.0

    def _apply(self) -> None:
        """Adds the forces that depend on the pose of this instant."""
        if self.arm.equations is not None:
            self.arm.equations.apply()
        if self._mechanisms is not None:
            self._mechanisms.apply()

    def step(self, torque: Vector) -> None:
        """Holds joint torques (n,) [N m] for one control period."""
        if not self._still:
            self._read_state()
        self.arm.torque[:] = torque
        if self._simple:
            mujoco.mj_step(self.model, self.data, self._substeps)
        else:
            for _ in range(self._substeps):
                self._step_once()
        self.arm.read_forces()

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

    def alarm(self) -> tuple[str, str] | None:
        """The simulator's own alarm as (name, text), if any."""
        number = self.data.warning.number
        if number.any():
            kind = mujoco.mjtWarning(int(np.argmax(number > 0))).name.removeprefix("mjWARN_")
            return "simulator_warning", f"MuJoCo warned of {kind} at {self.data.time:.4g} s"
        if not self.data.time > self._last_time:
            return "clock", f"the simulator's clock stands at {self.data.time:.4g} s"
        self._last_time = self.data.time
        if self.arm.diverged:
            force = float(np.linalg.norm(self.arm.wrench[:3]))
            return "force_bound", f"the contact exerts {force:.3g} N; the simulation has diverged"
        energy = self.arm.kinetic_energy()
        if not energy < ENERGY_BOUND:
            return "energy_bound", f"the arm holds {energy:.3g} J; the simulation has diverged"
        return None


def _index(name: str, names: list[str]) -> int | None:
    return names.index(name) if name in names else None
