"""The gains of a stage by the rules of its law, from the arm and the environment on each axis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.control.servo import drive_gains
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.laws.gains import AxisPlant, Gain, Gains, rows
from taskspec.laws.mechanism_form import damping_rate
from taskspec.laws.servo_loop import Contact, DrivenAxis, ServoLoop
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.plan.contacts import StageContacts
from taskspec.program.plan.environment import StageEnvironment
from taskspec.program.plan.gain_range import GainRange
from taskspec.program.plan.kinematics import StageKinematics
from taskspec.program.reference.axis_plan import AxisPlan
from taskspec.program.reference.constraints import equation_gains
from taskspec.program.sensor import SensorModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.program.world.stiffness import GRIP
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.robot.operational import SINGULAR
from taskspec.spec import Law
from taskspec.spec.law import Worth

Vector = NDArray[np.float64]

#: How many times the error of a reading may come back turned round before it grows.
FLIPPING = 2.0


@dataclass(frozen=True, slots=True)
class Design:
    """How a stage's law acts.

    Attributes:
        gains: on axes, equations and joints.
        consistent: it takes the form for a held mechanism.
        loop: its sampled loop, where the design has been held against that.
    """

    gains: Gains
    consistent: bool = False
    loop: Any = None


class DesignRules:
    """What the law's rules make of a stage."""

    def __init__(
        self,
        context: Context,
        law: Law,
        kinematics: StageKinematics,
        contacts: StageContacts,
        environment: StageEnvironment,
        plans: Mapping[Axis, AxisPlan],
        active: tuple[str, ...],
        moving_base: MovingBase | None,
        ranges: GainRange,
    ) -> None:
        """Of a stage.

        Args:
            context: the arm at the start pose.
            law: of the stage.
            kinematics: its axes.
            contacts: what it presses on or holds.
            environment: what returns forces on its axes.
            plans: who controls each of its axes.
            active: names of the equations that constrain it.
            moving_base: how the object moves that carries its frame; None where none does.
            ranges: the values of the expressions by which gains vary.
        """
        self._range = ranges
        self._context, self._law, self._kinematics = context, law, kinematics
        self._contacts, self._environment, self._plans = contacts, environment, plans
        self._active, self._moving_base = active, moving_base

    def design(self, *, consistent: bool = False, worth: Worth | None = None) -> Design:
        """Form and gains of the law.

        Args:
            consistent: whether it takes the form for a held mechanism.
            worth: values of the expressions by which gains vary; by default the nominal ones. What
                damps joints is that of these in any case.
        """
        values = self._range.nominal if worth is None else worth
        context, law, axes = self._context, self._law, self._kinematics.axes
        plants = self.plants
        if consistent:
            rate = damping_rate(context.period)
            plants = {a: replace(plant, damper=rate * plant.held) for a, plant in plants.items()}
        entries = {a: p.axis for a, p in self._plans.items()}
        gains = law.design(entries, plants, self._mobility, values)
        equations = equation_gains(context, law, self._active, context.equations, values)
        for gain, by in equations.items():
            gains.setdefault(gain, {}).update(by)
        if law.control_law.damps_joints and worth is None:
            stiffness = np.array(rows(gains, "stiffness", axes))
            stiffness[np.diag_indices_from(stiffness)] += [self._pressed(a) for a in axes]
            gains["joint_damping"] = law.design_joints(self._joint_plants(stiffness))
        return Design(gains, consistent)

    def along(self, axis: Axis, stiffness: float) -> dict[str, Gain]:
        """Gains of one axis, by name, if its contact had another stiffness [N/m]."""
        plant = self.plants[axis]
        servo = plant.servo
        if servo is not None:
            servo = replace(servo, contact=replace(servo.contact, k=stiffness))
        plants = {axis: replace(plant, k=stiffness, servo=servo)}
        gains = self._law.design({axis: self._plans[axis].axis}, plants)
        return {name: by_axis[axis] for name, by_axis in gains.items()}

    def in_joints(self) -> Design:
        """Gains of a path of joints: of the motion of each joint, and of the constraints."""
        context, law, values = self._context, self._law, self._range.nominal
        gains: Gains = {}
        free = np.zeros((len(self._kinematics.axes), len(self._kinematics.axes)))
        for i, plant in enumerate(self._joint_plants(free)):
            designed = law.design_joint(plant, turns=turns_at(context.robot, i), worth=values)
            for gain, value in designed.items():
                gains.setdefault(gain, {})[f"joint.{i + 1}"] = value
        equations = equation_gains(context, law, self._active, context.equations, values)
        for gain, by in equations.items():
            gains.setdefault(gain, {}).update(by)
        return Design(gains)

    @cached_property
    def _mobility(self) -> Vector:
        """(m, m) J H^-1 J^T on the axes at the start pose."""
        mobility = self._kinematics.axis_mobility
        if np.linalg.cond(mobility) > SINGULAR:
            # The run stops before its first tick; that it is said needs gains that are finite.
            mobility = mobility + np.abs(mobility).max() / SINGULAR * np.eye(len(mobility))
        return mobility

    @cached_property
    def plants(self) -> dict[Axis, AxisPlant]:
        """Mass and stiffness of each axis at the start pose."""
        mobility, environment = self._mobility, self._environment
        inertia = np.asarray(np.linalg.inv(mobility), dtype=np.float64)
        jams = [a for a in self._kinematics.axes if self._may_jam(a)]
        ratio, period = self._flip(mobility, inertia) if jams else 0.0, self._context.period
        return {
            a: AxisPlant(
                h=1.0 / mobility[i, i],
                held=inertia[i, i],
                k=environment.by_axis[a],
                period=period,
                grip=environment.grip_damping(a) if self._contacts.held else None,
                face=environment.face if a.is_rotation else 0.0,
                servo=self._servo_loop(a, 1.0 / mobility[i, i]),
                jammed=ratio / float(mobility[i, i]) if a in jams and ratio > FLIPPING else 0.0,
            )
            for i, a in enumerate(self._kinematics.axes)
        }

    def _servo_loop(self, axis: Axis, h: float) -> ServoLoop | None:
        """A force loop along an axis with so much effective mass; None over torques."""
        timing = self._context.drives.timing
        if timing is None:
            return None
        contact, face = self._environment.returns(axis), self._environment.face
        if axis.is_rotation and face > contact.k:
            contact = Contact(face)
        robot = self._context.loaded.task.robot
        sensed = robot.sensor.at == "wrist" and not axis.is_rotation
        carried = self._context.robot.tool_body.mass if sensed else 0.0
        stiffness = robot.servo.stiffness
        # Of another number of joints it is for another robot, which a rule says.
        if stiffness is None or len(stiffness) not in (1, self._context.robot.n):
            alone = DrivenAxis.alone(h, timing.w, timing.ratio)
            return ServoLoop(timing, alone, contact, carried)
        H, J = self._context.start_inertia, self._kinematics.jacobian[self._kinematics.rows]
        K, D = drive_gains(H, timing.w, timing.ratio, stiffness)
        root, i = np.linalg.cholesky(H), self._kinematics.axes.index(axis)
        # Joints, times the root of H transposed, are coordinates with the inertia one.
        across = np.linalg.solve(root, J.T)
        command = across @ np.linalg.inv(self._mobility)
        into = np.linalg.inv(root)
        arm = DrivenAxis(into @ K @ into.T, into @ D @ into.T, across[:, i], command[:, i])
        return ServoLoop(timing, arm, contact, carried)

    def _may_jam(self, axis: Axis) -> bool:
        """Whether it is a force axis along which walls and their friction may hold the tool."""
        contacts, context, name = self._contacts, self._context, self._contacts.main
        if axis.is_rotation or name is None or not self._plans[axis].force:
            return False
        walls = not context.surfaces[name].convex and context.loaded.task.shapes[name].friction > 0
        return walls and abs(contacts.facing(axis)) <= MOSTLY

    def _flip(self, mobility: Vector, inertia: Vector) -> float:
        """How many times the error of a reading comes back turned round where nothing can move.

        u + f of a reading becomes I - (1 - b) Lambda_ss M^-1 times itself in the next, with the
        axes s that give way, their apparent mass matrix M and the sensor's low-pass b. The largest
        eigenvalue of (1 - b) Lambda_ss M^-1 is returned, with the masses of the free arm: where it
        flips and grows, beyond 2, so many times as large masses make it 1.

        Args:
            mobility: J H^-1 J^T on the axes of the stage.
            inertia: Lambda, its inverse.
        """
        rows = [i for i, plan in enumerate(self._plans.values()) if plan.force or plan.soft]
        free, held = (each[np.ix_(rows, rows)] for each in (mobility, inertia))
        if not self._law.control_law.selects:
            free = np.diag(np.diag(free))
        sensor = self._context.loaded.task.robot.sensor
        pole = SensorModel.of(sensor, self._context.period).pole
        return (1 - pole) * float(np.max(np.linalg.eigvals(held @ free).real))

    def _pressed(self, axis: Axis) -> float:
        """Stiffness of the contact that an axis presses on [N/m, N m/rad]; 0 where it does not.

        Along an exact equation nothing moves that joints could damp.
        """
        k = self.plants[axis].k if self._plans[axis].set_point else 0.0
        return k if math.isfinite(k) else 0.0

    def _joint_plants(self, stiffness: Vector) -> list[AxisPlant]:
        """Inertia and stiffness about each joint at the start pose.

        Args:
            stiffness: (m, m) of spring and contact together, on the axes [N/m, N m/rad].
        """
        context = self._context
        J = self._kinematics.tip_jacobian
        about = np.einsum("ij,i,ij->j", J, np.diag(stiffness), J)
        if np.count_nonzero(stiffness - np.diag(np.diag(stiffness))):
            about = np.einsum("ij,ik,kj->j", J, stiffness, J)
        free = 1.0 / np.diag(np.linalg.inv(context.start_inertia))
        held = np.diag(context.start_inertia)
        return [
            AxisPlant(h=free[j], held=held[j], k=about[j], period=context.period)
            for j in range(len(held))
        ]

    # On a held mechanism

    @property
    def has_mechanism_form(self) -> bool:
        """Whether the law has a form for the held mechanism, seen as the stage's frame does."""
        law = self._law
        fits = law.control_law.mechanism_form and law.orientation == "so3" and not self._active
        return bool(self._contacts.held) and fits and self._moving_base is None and not law.matrices

    @property
    def cancels_late(self) -> float:
        """How much larger, every tick, the grip's damping makes what a law takes off too late.

        rho(T (M - S_y M_yy S_y^T) D_g) at the start pose, with M = J H^-1 J^T, the axes y that give
        way, and the damping D_g of the grip: a law that selects takes the measured force off all
        but the block of these. From 1 on it flips from tick to tick, whatever its gains. 0 for a
        law that does not select, and where nothing is held.
        """
        held, kinematics = self._contacts.held, self._kinematics
        if not (held and self._law.control_law.selects):
            return 0.0
        late, context = kinematics.axis_mobility, self._context
        yielding = [i for i, p in enumerate(self._plans.values()) if p.force or p.soft]
        late[np.ix_(yielding, yielding)] = 0.0
        # Twist of the tip, world axes, per rates of the axes.
        J = np.kron(np.eye(2), kinematics.rotation)
        J[:3, 3:] = np.cross(kinematics.lever, kinematics.rotation, axisb=0, axisc=0)
        J, turned = J[:, kinematics.rows], context.mechanisms[held].rotation[:, 2]
        grip = np.diag([GRIP.damping] * 3 + [GRIP.angular_damping] * 3)
        if context.mechanisms[held].free:
            grip[3:, 3:] -= GRIP.angular_damping * np.outer(turned, turned)
        return float(np.max(np.abs(np.linalg.eigvals(context.period * late @ (J.T @ grip @ J)))))
