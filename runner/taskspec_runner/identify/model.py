"""What a log's readings and joints would be in a world, by the equations that the plant steps."""

from __future__ import annotations

from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.program import Program
from taskspec.program.sensor import SensorModel
from taskspec.robot.rebuild import GRAVITY
from taskspec.spec import Sensor, Shape, Task
from taskspec_runner.identify.contact import BallContact, Setting, Touching
from taskspec_runner.identify.joints import FreeJoints
from taskspec_runner.identify.motion import LoggedMotion, Readings, motion_of
from taskspec_runner.identify.parameters import identifiable
from taskspec_runner.identify.rows import cross_rows, turned_rows
from taskspec_runner.identify.sensor import readings
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.payload import weigh
from taskspec_runner.record.history import History

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: An axis that has less than this share of a normal is across it.
_ACROSS = 1e-6
#: A ball that is farther than this from a shape does not touch it, however it is placed [m].
_OFF = 1e-3
#: Ticks in which a ball is farther from a shape, as iterations start, are left out [m].
_NEAR = 0.01
#: Fewer ticks than these say nothing of joints.
_LEAST_ROWS = 50


class LogModel:
    """One log, and what a world would have made of it.

    Rows are those ticks of the log of which the step before is known: all but the first.

    Attributes:
        name: of the log, for messages.
        history: of it.
        motion: of the arm in the steps that the rows' readings come from.
        measured: the readings.
        open: whether the file does not say that the sensor turns with the tool.
        turns: whether it is taken to: each reading is then turned into the world with the tool's
            axes of the tick, else with those of the step that it comes from.
        firm: whether friction is taken to creep as little as it may, whatever the damping is.
    """

    def __init__(self, program: Program, history: History, name: str) -> None:
        """Reads a log.

        Raises:
            InputError: it lacks what is needed.
        """
        self.name, self.history = name, history
        self._program, self._context = program, program.context
        self._nominal = program.context.loaded.task
        self.motion: LoggedMotion = motion_of(program, history)
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
        self._into: dict[bool, Vector] = {}
        self._near: dict[str, NDArray[np.int64]] = {}
        self._touching: dict[str, tuple[object, Touching]] = {}
        self._kept: dict[tuple[int, int, bool], Vector] = {}
        stages = task.stages.values()
        self.open = task.robot.sensor == Sensor() and not any(each.tare for each in stages)
        self.turns = not self.open
        self.firm = False

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
        return self._touch(name, task.shapes[name]).wrench(
            task.shapes[name], Setting.of(task, mobility, firm=self.firm)
        )

    def begun(self, name: str, task: Task) -> NDArray[np.int64]:
        """The ticks at which the ball begins to touch a shape, but for the first of the log."""
        rows = self._touch(name, task.shapes[name]).rows
        return np.asarray(rows[(np.diff(rows, prepend=rows[:1]) != 1) & (rows > 0)])

    def heights(self, name: str, task: Task, rows: NDArray[np.int64]) -> Vector:
        """(k,) of the ball above a shape in some ticks [m]."""
        d, _ = self._contacts[name].surroundings(self._center[rows], task.shapes[name])
        return np.asarray(d - self._radius)

    def _touch(self, name: str, shape: Shape) -> Touching:
        """The ticks in which the ball touches a shape, kept for its last place."""
        if name not in self._near:
            d, _ = self._contacts[name].surroundings(self._center, shape)
            self._near[name] = np.flatnonzero(d < self._radius + _NEAR)
        place, touching = self._touching.get(name, (None, None))
        if touching is None or place != (shape.xyz, shape.rpy):
            touching = self._contacts[name].touching(
                self.motion, self._center, self._radius, shape, self._near[name]
            )
            self._touching[name] = (shape.xyz, shape.rpy), touching
        return touching

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
        center = accelerated[:, :3] + cross_rows(turn, r) + cross_rows(spin, cross_rows(spin, r))
        force = -mass * (center - np.array(GRAVITY))
        moment = cross_rows(r, force)
        if inertia is not None:
            world = motion.R @ inertia @ motion.R.transpose(0, 2, 1)
            about = np.einsum("kij,kj->ki", world, turn)
            moment -= about + cross_rows(spin, np.einsum("kij,kj->ki", world, spin))
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
        return self.turned(total)

    def turned(self, wrench: Vector) -> Vector:
        """(ticks, 6) wrenches of world axes in the sensor's own."""
        return turned_rows(self.motion.R.transpose(0, 2, 1), wrench)

    def passed(self, own: Vector, task: Task) -> Vector:
        """(ticks, 6) what the log has of wrenches in the sensor's own axes, without weight."""
        return self.logged(readings(own, SensorModel.of(task.robot.sensor, self.period)))

    def shown(self, own: Vector, task: Task) -> Vector:
        """(ticks, 6) the readings in the log's axes; bias and zero are not in them."""
        model = SensorModel.of(task.robot.sensor, self.period)
        made = readings(own, model)
        if task.robot.sensor.at == "wrist":
            body = self._context.robot.tool_body
            force = body.mass * (self._tip_axes.transpose(0, 2, 1) @ np.array(GRAVITY))
            made = made - np.hstack([force, cross_rows(np.asarray(body.lever)[None], force)])
        return self.logged(made)

    def logged(self, tool: Vector) -> Vector:
        """(ticks, 6) wrenches in the tool's axes about the tip, as the log has them."""
        if self._lever is not None:
            R = self._tip_axes if self.turns else self.motion.R
            tool = tool.copy()
            lever = (R.transpose(0, 2, 1) @ self._lever[..., None])[..., 0]
            tool[:, 3:] -= cross_rows(lever, tool[:, :3])
        return turned_rows(self._into_log, tool)

    @property
    def _into_log(self) -> Vector:
        """(ticks, 3, 3) from the tool's axes to the log's."""
        if self.turns not in self._into:
            R = self._tip_axes if self.turns else self.motion.R
            self._into[self.turns] = self.measured.axes[1:].transpose(0, 2, 1) @ R
        return self._into[self.turns]

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
        key = component, epoch, self.turns
        if key not in self._kept:
            self._kept[key] = self._constant(component, epoch)
        return self._kept[key]

    def _constant(self, component: int, epoch: int) -> Vector:
        unit = np.zeros((self.ticks, 6))
        unit[self.measured.epoch[1:] == epoch, component] = 1.0
        return self.logged(unit)

    # What the joints do.

    def joints(self, task: Task) -> FreeJoints | None:
        """The joints where the ball is clearly off every shape; None without torques of them."""
        if self.motion.exerted is None or self._context.robot.coupling.couples:
            return None
        off = np.ones(self.ticks, dtype=bool)
        for name, contact in self._contacts.items():
            d, _ = contact.surroundings(self._center, task.shapes[name])
            off &= d > self._radius + _OFF
        rows = np.flatnonzero(off)
        return FreeJoints(self._context, self.motion, rows) if len(rows) > _LEAST_ROWS else None


def mobility(program: Program, task: Task) -> float:
    """The tool's as MuJoCo counts it, with what it carries in a world [1/kg]."""
    robot = program.context.robot
    if task.robot.payload is None or not task.robot.payload.mass:
        return float(robot.tool_body.mobility)
    arm = SceneArm(robot, task.robot, program.context.start)
    return weigh(robot.spec.copy(), arm)
