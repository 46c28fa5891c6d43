"""What a log's readings and joints would be in a world, by the equations that the plant steps."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.program import Program
from taskspec.program.sensor import SensorModel
from taskspec.robot.rebuild import GRAVITY
from taskspec.spec import Sensor, Task
from taskspec_runner.identify.contact import BallContact, Setting
from taskspec_runner.identify.motion import Motion, Readings, motion_of
from taskspec_runner.identify.parameters import identifiable
from taskspec_runner.identify.sensor import readings
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.payload import weigh
from taskspec_runner.record.history import History

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: A joint that is slower than this may stick [rad/s, m/s].
_SLOW = 0.01
#: An axis that has less than this share of a normal is across it.
_ACROSS = 1e-6
#: Where friction is not known, a joint slides from this share of its largest speed on.
_FASTEST = 0.7
#: So many times as fast as it creeps at most it slides for sure.
_SURELY = 1.5
#: MuJoCo's impedance of a joint's friction, and the rate [1/s] at which it takes a slip away.
_FRICTION_IMPEDANCE, _FRICTION_RATE = 0.9, 2.0 / (0.95 * 0.02)
#: A ball that is farther than this from a shape does not touch it, however it is placed [m].
_OFF = 1e-3


class LogModel:
    """One log, and what a world would have made of it.

    Rows are those ticks of the log of which the step before is known: all but the first.

    Attributes:
        name: of the log, for messages.
        history: of it.
        motion: of the arm in the steps that the rows' readings come from.
        measured: the readings.
    """

    def __init__(self, program: Program, history: History, name: str) -> None:
        """Reads a log.

        Raises:
            InputError: it lacks what is needed.
        """
        self.name, self.history = name, history
        self._program, self._context = program, program.context
        self._nominal = program.context.loaded.task
        self.motion: Motion = motion_of(program, history)
        self.measured = Readings(program, history)
        task = self._nominal
        tool = program.context.robot.tool
        self._contacts = {
            each: BallContact.of(each, task.shapes[each])
            for each in task.shapes
            if identifiable(task, each)
        }
        self._center = self.motion.p + self.motion.R @ tool.centers[0]
        self._radius = float(tool.radii[0])
        self._kept: dict[tuple[int, int], Vector] = {}
        self._turns = task.robot.sensor != Sensor() or any(s.tare for s in task.stages.values())

    @property
    def ticks(self) -> int:
        """Rows."""
        return len(self.motion.p)

    @property
    def period(self) -> float:
        """Of control [s]."""
        return self._context.period

    @cached_property
    def epochs(self) -> int:
        """Number of tares that readings come after."""
        return int(self.measured.epoch.max())

    @cached_property
    def readings(self) -> Vector:
        """(ticks, 6) as the log has them, by the environment; NaN where there are none."""
        return np.where(self.measured.present, self.measured.values, np.nan)[1:]

    # What the world exerts.

    def contacts(self, task: Task, mobility: float) -> dict[str, Vector]:
        """(ticks, 6) what each shape exerts on the tip, world axes [N, N m]."""
        return {name: self.contact(name, task, mobility) for name in self._contacts}

    def contact(self, name: str, task: Task, mobility: float) -> Vector:
        """(ticks, 6) what one shape exerts on the tip, world axes [N, N m]."""
        setting, shape = Setting.of(task, mobility), task.world[name]
        return self._contacts[name].wrench(self.motion, self._center, self._radius, shape, setting)

    def touch(self, name: str, task: Task) -> tuple[Vector, Vector, Vector]:
        """(k,) heights of the ball above a shape, (k,) forces along its normal, (k, 3) normals."""
        axes, forces = self.measured.axes[1:], self.readings[:, :3]
        d, n = self._contacts[name].surroundings(self._center, task.shapes[name])
        # A log may have the components along the normal alone.
        along = np.einsum("kji,kj->ki", axes, n)
        needed = np.abs(along) > _ACROSS
        there = np.isfinite(axes).all(axis=(1, 2)) & (np.isfinite(forces) | ~needed).all(axis=1)
        pressed = np.where(needed, along * forces, 0.0).sum(axis=1)
        return d[there] - self._radius, pressed[there], n[there]

    def hanging(self, mass: float, lever: Vector, inertia: Vector | None = None) -> Vector:
        """(ticks, 6) what a body exerts on the tip that carries it, world axes [N, N m].

        Args:
            mass: [kg].
            lever: (3,) its centre from the tip, in the tool's axes [m].
            inertia: (3, 3) about that, in the tool's axes [kg m^2]; None for a point mass.
        """
        motion = self.motion
        r = motion.R @ lever
        accelerated = motion.push + motion.drift
        spin, turn = motion.twist[:, 3:], accelerated[:, 3:]
        center = accelerated[:, :3] + np.cross(turn, r) + np.cross(spin, np.cross(spin, r))
        force = -mass * (center - np.array(GRAVITY))
        moment = np.cross(r, force)
        if inertia is not None:
            world = motion.R @ inertia @ motion.R.transpose(0, 2, 1)
            about = np.einsum("kij,kj->ki", world, turn)
            moment -= about + np.cross(spin, np.einsum("kij,kj->ki", world, spin))
        return np.hstack([force, moment])

    @cached_property
    def _tool(self) -> Vector:
        """(ticks, 6) what the tool that the file has exerts on the flange, about the tip."""
        body = self._context.robot.tool_body
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, np.asarray(body.axes, dtype=float))
        R = axes.reshape(3, 3)
        return self.hanging(body.mass, np.asarray(body.lever), R @ np.diag(body.moments) @ R.T)

    # What is read of it.

    def own(self, contact: Vector, task: Task) -> Vector:
        """(ticks, 6) what the sensor measures in its own axes, without bias [N, N m].

        Args:
            contact: (ticks, 6) of all contacts, world axes.
            task: with payload and place of the sensor.
        """
        total = contact
        if task.robot.sensor.at == "wrist":
            total = total + self._tool
            load = task.robot.payload
            if load is not None and load.mass:
                total = total + self.hanging(load.mass, np.array(load.xyz))
        return _turned(self.motion.R.transpose(0, 2, 1), total)

    def shown(self, own: Vector, task: Task) -> Vector:
        """(ticks, 6) the readings in the log's axes; bias and zero are not in them."""
        model = SensorModel.of(task.robot.sensor, self.period)
        made = readings(own, model)
        if task.robot.sensor.at == "wrist":
            body = self._context.robot.tool_body
            force = body.mass * (self._tip_axes.transpose(0, 2, 1) @ np.array(GRAVITY))
            made = made - np.hstack([force, np.cross(np.asarray(body.lever), force)])
        return self.logged(made)

    def logged(self, tool: Vector) -> Vector:
        """(ticks, 6) wrenches in the tool's axes about the tip, as the log has them."""
        if self._lever is not None:
            R = self._tip_axes if self._turns else self.motion.R
            tool = tool.copy()
            lever = (R.transpose(0, 2, 1) @ self._lever[..., None])[..., 0]
            tool[:, 3:] -= np.cross(lever, tool[:, :3])
        return _turned(self._into_log, tool)

    @cached_property
    def _into_log(self) -> Vector:
        """(ticks, 3, 3) from the tool's axes to the log's."""
        R = self._tip_axes if self._turns else self.motion.R
        return np.asarray(self.measured.axes[1:].transpose(0, 2, 1) @ R)

    @cached_property
    def _lever(self) -> Vector | None:
        """(ticks, 3) from the tip to what the log's moments are about; None where it is the tip."""
        lever = self.measured.lever[1:]
        return lever if lever.any() else None

    @property
    def _tip_axes(self) -> Vector:
        return self.measured.tip_axes[1:]

    def constant(self, component: int, epoch: int) -> Vector:
        """(ticks, 6) what one unit of a constant reading is in the log, between two tares."""
        if (component, epoch) not in self._kept:
            self._kept[component, epoch] = self._constant(component, epoch)
        return self._kept[component, epoch]

    def _constant(self, component: int, epoch: int) -> Vector:
        unit = np.zeros((self.ticks, 6))
        unit[self.measured.epoch[1:] == epoch, component] = 1.0
        return self.logged(unit)

    # What the joints do.

    @property
    def torques(self) -> Vector | None:
        """(ticks, joints) that move the nominal arm as the log's arm moved; None if not known."""
        return None if self.motion.exerted is None else self.motion.torque

    def moving(self, friction: Vector | None) -> Mask:
        """(ticks, joints) where a joint moves so fast that it slides.

        Args:
            friction: (joints,) its friction [N m, N]; None where that is not known: then it is
                when it is nearly as fast as ever.
        """
        speed = np.abs(self.motion.rates)
        if friction is None:
            creeps = _FASTEST * speed.max(axis=0)
        else:
            # As MuJoCo's joints creep below their friction.
            dofs = self._context.robot.model.dof_invweight0[: speed.shape[1]]
            creeps = _SURELY * friction * (1 - _FRICTION_IMPEDANCE) / _FRICTION_IMPEDANCE * dofs
            creeps = creeps / _FRICTION_RATE
        return np.asarray(speed > np.maximum(creeps, _SLOW))

    def free(self, task: Task) -> Mask:
        """(ticks,) where the ball is clearly off every shape."""
        off = np.ones(self.ticks, dtype=bool)
        for name, contact in self._contacts.items():
            d, _ = contact.surroundings(self._center, task.world[name])
            off &= d > self._radius + _OFF
        return off

    def torques_in(self, task: Task, moving: Mask | None) -> Vector:
        """(ticks, joints) that move the nominal arm as the log's torques would move a world's.

        H a + C v + g of the acceleration a that those give the arm with its true payload, joint
        damping and joint friction, where nothing touches it.

        Args:
            task: with these.
            moving: (ticks, joints) which joints slide, the others accelerate as they did; None
                where no joint sticks.
        """
        motion, robot = self.motion, task.robot
        assert motion.exerted is not None
        n = motion.rates.shape[1]
        damping = np.broadcast_to(robot.joint_damping, n)
        friction = np.broadcast_to(robot.joint_friction, n)
        known = motion.exerted - motion.bias - damping * motion.rates
        known -= friction * np.sign(motion.rates)
        load = robot.payload
        if not (load is not None and load.mass) and not damping.any() and moving is None:
            return np.asarray(known + motion.bias)
        H = motion.inertia + np.diag(damping) / task.control.plant_rate
        if load is not None and load.mass:
            r = motion.R @ np.array(load.xyz)
            J = motion.jacobian[:, :3] - np.cross(r[:, :, None], motion.jacobian[:, 3:], axis=1)
            drift, spin = motion.drift, motion.twist[:, 3:]
            still = drift[:, :3] + np.cross(drift[:, 3:], r) + np.cross(spin, np.cross(spin, r))
            H += load.mass * (J.transpose(0, 2, 1) @ J)
            weight = load.mass * (still - np.array(GRAVITY))
            known -= (J.transpose(0, 2, 1) @ weight[..., None])[..., 0]
        if moving is not None:
            stuck = ~moving
            H[stuck] = np.broadcast_to(np.eye(n), H.shape)[stuck]
            known = np.where(stuck, motion.acceleration, known)
        moved = np.linalg.solve(H, known[..., None])
        return np.asarray((motion.inertia @ moved)[..., 0] + motion.bias)


def mobility(program: Program, task: Task) -> float:
    """The tool's as MuJoCo counts it, with what it carries in a world [1/kg]."""
    robot = program.context.robot
    if task.robot.payload is None or not task.robot.payload.mass:
        return float(robot.tool_body.mobility)
    arm = SceneArm(robot, task.robot, program.context.start)
    return weigh(robot.spec.copy(), arm)


def _turned(R: Vector, wrench: Vector) -> Vector:
    """(n, 6) wrenches with both parts turned by R (n, 3, 3)."""
    made = np.empty_like(wrench)
    for i in range(3):
        for part in (0, 3):
            x = wrench[:, part : part + 3]
            made[:, part + i] = R[:, i, 0] * x[:, 0] + R[:, i, 1] * x[:, 1] + R[:, i, 2] * x[:, 2]
    return made
