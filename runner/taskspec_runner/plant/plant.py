"""The plant that the loop steps: its arm, the world around it, and the simulator's own alarms."""

from __future__ import annotations

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import Wiring
from taskspec.program.execution.observer import Observer
from taskspec.program.world.mechanisms import mechanism_models
from taskspec.robot import RobotModel
from taskspec.spec import Task
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.equations import Equations
from taskspec_runner.plant.grasp import Grip
from taskspec_runner.plant.handling import Handling, handles, taken
from taskspec_runner.plant.joint_servo import JointServo
from taskspec_runner.plant.loose import LooseBodies, loose
from taskspec_runner.plant.mechanisms import Mechanisms
from taskspec_runner.plant.moving_base import MovingBases, moving
from taskspec_runner.plant.rigid_constraints import RigidConstraints
from taskspec_runner.plant.scene import Scene, build_scene
from taskspec_runner.plant.views import PlantViews
from taskspec_runner.plant.wrist import wrist_wrench

Vector = NDArray[np.float64]

#: No contact of a sane task exerts more [N].
FORCE_BOUND = 1e5
_SQUARED_FORCE_BOUND = FORCE_BOUND**2
#: Nor does an arm hold more kinetic energy [J].
ENERGY_BOUND = 1e4


class PlantArm:
    """An arm of a plant: its state, what drives it, and the forces on its tool.

    Attributes:
        q, v: (n,) the true positions and velocities of the joints that move by themselves [rad or
            m, and by s]. Where none follows another, they are views of `joints` and `rates`.
        joints, rates: (k,) views of the true positions and velocities of all joints.
        torque: (n,) view of what the motors exert [N m, N].
        velocities: where all joints are among the plant's degrees of freedom.
        wrench: (6,) of the last step, by the environment on the tool tip, world axes [N, N m].
        object_forces: (shapes,) magnitude of the contact force with each shape [N].
        wrist: (6,) the wrench as a sensor between flange and tool measures it, with the tool's
            weight and inertia; None unless the sensor is at the wrist.
        grip: what it holds something with; None where it holds nothing.
        equations: the springs of constraints on it, and bushings; None where there are none.
        rigid: the constraints that hold exactly; None where there are none.
        handling: grips loose bodies, and what takes them; None where nothing does.
        servo: follows what its joints are commanded; None where these are torques.
        forces: writes the wrenches and forces, and what of the state has no view.
        sensor, encoder: the true ones; no encoder where readings are exact.
        tip_rotation: (9,) the tip's axes in the last step, row by row.
        rests: whether it rests on brakes before the first step, as its sensor carries the tool.
        diverged: the last step's contact force is beyond all bounds.
    """

    def __init__(self, scene: Scene, data: mujoco.MjData, task: Task, views: PlantViews) -> None:
        """The arm of a scene; `views` take the forces on its tool."""
        arm, model = scene.arm, scene.model
        places = arm.places(model)
        self.joints, self.rates = data.qpos[places.positions], data.qvel[places.velocities]
        self.q, self.v = self.joints, self.rates
        self.torque, self.velocities = data.ctrl[places.motors], places.velocities
        self.wrench, self.object_forces = views.wrench, views.objects
        self.sensor, self.encoder = arm.declared.sensor, arm.declared.encoder
        self.tip_rotation = data.xmat[places.tip]
        self.diverged = False
        self._model, self._data = model, data
        own = views.equations[: len(task.equations)]
        exact = [each.exact for each in task.equations.values()]
        sprung = bool(task.bushings) or not all(exact)
        self.equations = Equations(model, data, arm, task, own, views.bushings) if sprung else None
        self.rigid = RigidConstraints(model, data, arm, task, own) if any(exact) else None
        report = views.equations[len(task.equations) :]
        self.handling = Handling(model, data, arm, task, report) if handles(task) else None
        self.servo = (
            None if arm.declared.takes_torques else JointServo(model, data, arm, task, views)
        )
        wiring = Wiring()
        self.grip = Grip(model, data, arm, task, wiring) if arm.held else None
        self.wrist = np.zeros(6) if self.sensor.at == "wrist" else None
        self.rests = self.grip is not None or self.wrist is not None
        if arm.robot.coupling.couples:
            self.q, self.v = np.zeros(arm.robot.n), np.zeros(arm.robot.n)
            free = list(arm.robot.coupling.free)
            wiring.writes(wiring.reads("joints", self.joints)[free], self.q)
            wiring.writes(wiring.reads("rates", self.rates)[free], self.v)
        self._coupling = arm.robot.coupling
        tip = wiring.reads("tip", data.xpos[places.tip])
        sensed = wiring.reads("contacts", data.sensordata)
        on_tip, objects = _contacts(scene, sensed, tip)
        efforts: dict[str, ca.SX] = {}
        on_tip += self._of_constraints(wiring)
        if self.grip is not None:
            on_tip += self.grip.wrench
            if arm.held in task.mechanisms:
                efforts = {arm.held: self.grip.effort}
            else:
                objects[list(task.shapes).index(arm.held)] = self.grip.effort
        if self.handling is not None:
            efforts |= self._of_handling(task, objects, wiring)
        for name, effort in _pushed(scene, sensed, task).items():
            efforts[name] = efforts.get(name, 0) + effort
        for i, name in enumerate(task.mechanisms):
            if name in efforts:
                wiring.writes(efforts[name], views.mechanism_efforts[i : i + 1])
        if self.wrist is not None:
            wiring.writes(wrist_wrench(model, data, arm, on_tip, wiring), self.wrist)
        wiring.writes(on_tip, self.wrench)
        squared = np.zeros(1)
        wiring.writes(ca.sumsqr(on_tip[:3]), squared)
        # Memory gives a number in half the time that an array does.
        self._squared_force = squared.data
        wiring.writes(ca.vertcat(ca.SX(0, 1), *objects), self.object_forces)
        #: All that acts on the tool, of what MuJoCo has left of a step.
        self.forces = wiring.bound("forces")

    def _of_constraints(self, wiring: Wiring) -> ca.SX:
        """(6,) what equations and bushings exert on the tip, world axes [N, N m]."""
        on_tip = ca.SX.zeros(6)
        if self.equations is not None:
            on_tip[:3] += wiring.reads("equations", self.equations.on_tip)
            if self.equations.turns:
                on_tip[3:] += wiring.reads("moments", self.equations.about_tip)
        if self.rigid is not None:
            on_tip += wiring.reads("rigid", self.rigid.on_tip)
        if self.handling is not None:
            on_tip[:3] += wiring.reads("pads", self.handling.on_tip)
            on_tip[3:] += wiring.reads("pad_moments", self.handling.about_tip)
        return on_tip

    def _of_handling(self, task: Task, objects: list[ca.SX], wiring: Wiring) -> dict[str, ca.SX]:
        """What bodies apply to the screws that take them; adds the pads' forces to `objects`."""
        assert self.handling is not None
        held = wiring.reads("held", self.handling.object_forces)
        for i, name in enumerate(task.gripped):
            objects[list(task.shapes).index(name)] += held[i]
        efforts = wiring.reads("screwed", self.handling.efforts)
        return {name: efforts[i] for i, name in enumerate(taken(task))}

    def put(self, q: Vector, v: Vector | None = None) -> None:
        """Puts the joints at positions q (n,), and velocities v (n,); None leaves these."""
        self.joints[:] = self._coupling.joints(q)
        if v is not None:
            self.rates[:] = self._coupling.rates(v)

    def read_forces(self) -> None:
        """Reads the forces of the last step."""
        if self.grip is not None:
            self.grip.read()
        self.forces.evaluate()
        self.diverged = not self._squared_force[0] < _SQUARED_FORCE_BOUND

    def kinetic_energy(self) -> float:
        """Kinetic energy of the arm [J]."""
        velocity, momentum = np.zeros(self._model.nv), np.zeros(self._model.nv)
        velocity[self.velocities] = self.rates
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
        substeps: of MuJoCo in a control period.
        simple: whether MuJoCo's step is all there is to a step.
        mechanisms, moving_bases, loose: what else there is in the world; None where there is none.
        last_time: of the simulator at the last look at its alarms [s].
        observer: of the truth, where joints are not measured as they are; None where they are.
    """

    observer: Observer | None = None

    def __init__(
        self, robot: RobotModel, task: Task, start: Vector, views: PlantViews | None = None
    ) -> None:
        """Builds the plant at joint positions `start` (n,), at rest.

        `task` is the true one; `views` are vectors that the caller wants filled.
        """
        self.scene: Scene = build_scene(SceneArm(robot, task.robot, start), task)
        model = self.model = self.scene.model
        data = self.data = mujoco.MjData(model)
        self.views = views = PlantViews.new(task, robot.n) if views is None else views
        arm = self.arm = PlantArm(self.scene, data, task, views)
        arm.put(start)
        self.substeps = round(task.control.plant_rate / task.control.rate)
        self.last_time = data.time
        self.mechanisms = Mechanisms(model, data, task.mechanisms) if task.mechanisms else None
        self.moving_bases = MovingBases(model, data, task) if moving(task) else None
        self.loose = LooseBodies(model, data, task) if loose(task) else None
        detents = None if self.mechanisms is None else self.mechanisms.detents
        applied = arm.equations or arm.rigid or arm.handling
        self.simple = not (applied or arm.servo or self.moving_bases or detents)
        self._still = self.mechanisms is None and self.loose is None
        self._settle()
        self._read_state()
        arm.read_forces()

    def _settle(self) -> None:
        """Finds the forces before the first step; an arm with a wrist sensor rests on brakes."""
        model, data, arm = self.model, self.data, self.arm
        if self.moving_bases is not None:
            self.moving_bases.drive()
        mujoco.mj_forward(model, data)
        if arm.rests:
            joints = arm.velocities
            data.qfrc_applied[joints] = data.qfrc_bias[joints] - data.qfrc_passive[joints]
        if not self.simple:
            self._apply()
        if arm.handling is not None:
            arm.handling.begin()
        if arm.rests or not self.simple:
            mujoco.mj_forward(model, data)
            data.qfrc_applied[:] = 0.0

    def _apply(self) -> None:
        """Adds the forces that depend on the pose of this instant."""
        if self.arm.equations is not None:
            self.arm.equations.apply()
        if self.arm.handling is not None:
            self.arm.handling.apply()
        if self.mechanisms is not None:
            self.mechanisms.apply()

    def release(self) -> Plant:
        """The plant itself: it is for this process to bring its arm to rest."""
        return self

    def step(self, command: Vector) -> None:
        """Holds a command to the joints (n,) for one control period.

        Torques [N m, N], or what the arm's servo follows: velocities [rad/s, m/s] or positions.
        """
        if not self._still:
            self._read_state()
        if self.observer is not None:
            self.observer.observe()
        servo, handling = self.arm.servo, self.arm.handling
        if handling is not None:
            handling.command[:] = handling.source
        if servo is None:
            self.arm.torque[:] = command
        else:
            servo.command[:] = command
        if self.simple:
            mujoco.mj_step(self.model, self.data, self.substeps)
        else:
            for number in range(self.substeps):
                self._step_once(number)
        if servo is not None:
            servo.show()
        self.arm.read_forces()

    def _step_once(self, number: int) -> None:
        model, data = self.model, self.data
        data.qfrc_applied[:] = 0.0
        if self.moving_bases is not None:
            self.moving_bases.drive()
        mujoco.mj_step1(model, data)
        self._apply()
        if self.arm.servo is not None:
            self.arm.servo.serve(number)
        if self.arm.rigid is not None:
            self.arm.rigid.apply()
        mujoco.mj_step2(model, data)

    def _read_state(self) -> None:
        """The world's state of this instant."""
        views = self.views
        if self.mechanisms is not None:
            self.mechanisms.read(views.mechanism_positions, views.mechanism_rates)
        if self.loose is not None:
            self.loose.read(views.loose)

    def alarm(self) -> tuple[str, str] | None:
        """The simulator's own alarm as (name, text), if any."""
        number = self.data.warning.number
        if number.any():
            kind = mujoco.mjtWarning(int(np.argmax(number > 0))).name.removeprefix("mjWARN_")
            return "simulator_warning", f"MuJoCo warned of {kind} at {self.data.time:.4g} s"
        if not self.data.time > self.last_time:
            return "clock", f"the simulator's clock stands at {self.data.time:.4g} s"
        self.last_time = self.data.time
        if self.arm.diverged:
            force = float(np.linalg.norm(self.arm.wrench[:3]))
            return "force_bound", f"the contact exerts {force:.3g} N; the simulation has diverged"
        energy = self.arm.kinetic_energy()
        if not energy < ENERGY_BOUND:
            return "energy_bound", f"the arm holds {energy:.3g} J; the simulation has diverged"
        return None


def _pushed(scene: Scene, sensed: ca.SX, task: Task) -> dict[str, ca.SX]:
    """What the tool applies to mechanisms by the shapes that they carry [N m, N], by their names.

    Args:
        scene: for where the contact sensors are.
        sensed: all sensor data.
        task: the true one.
    """
    models = mechanism_models(task)
    found: dict[str, ca.SX] = {}
    for shape, where in zip(task.shapes.values(), scene.sensors, strict=True):
        if shape.on is not None:
            force, torque, point = (sensed[where.start + 3 * i :][:3] for i in range(3))
            effort = models[shape.on].effort(point, -force, -torque)
            found[shape.on] = found.get(shape.on, 0) + effort
    return found


def _contacts(scene: Scene, sensed: ca.SX, tip: ca.SX) -> tuple[ca.SX, list[ca.SX]]:
    """(6,) sum of the tool's contacts about the tip, and the magnitude of each one's force [N].

    Args:
        scene: for where the contact sensors are.
        sensed: all sensor data.
        tip: (3,) in the world.
    """
    total, magnitudes = ca.SX.zeros(6), []
    for where in scene.sensors:
        force, torque, point = (sensed[where.start + 3 * i :][:3] for i in range(3))
        magnitudes.append(ca.norm_2(force))
        total += ca.vertcat(force, torque + ca.cross(point - tip, force))
    return total, magnitudes
