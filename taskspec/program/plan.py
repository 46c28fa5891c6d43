"""A stage of a task, with what holds for it before any expression is built."""

from __future__ import annotations

import copy
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.laws.gains import AxisPlant, Gains, value_of
from taskspec.motion.path import PathShape
from taskspec.program.axes import MOSTLY, existing_axes
from taskspec.program.context import Context
from taskspec.program.prepare import frame_at_start
from taskspec.program.reference import orientation
from taskspec.program.reference.constraints import active_equations, equation_gains
from taskspec.program.reference.coupling import Coupling, coupling
from taskspec.program.reference.modes import AxisPlan, plan_axes
from taskspec.program.reference.paths import path_shape
from taskspec.program.trajectory import Nominal
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.grip import GRIP
from taskspec.program.world.moving_base import MovingBase
from taskspec.spec import Law, Limits, Stage

Vector = NDArray[np.float64]


class StagePlan:
    """What is decided about a stage: each thing once, when it is first asked for.

    Checks, predictions, analysis and compilation share it.

    Attributes:
        context: robot, start, frames and surfaces of the task.
        name: of the stage.
        spec: its entry in the file.
        nominal: its nominal trajectory; set by the plan of the task as that follows it.
    """

    context: Context
    name: str
    spec: Stage
    nominal: Nominal

    def __init__(self, context: Context, name: str) -> None:
        self.context, self.name = context, name
        self.spec = context.loaded.task.stages[name]

    @property
    def followed(self) -> bool:
        """Whether its nominal trajectory is known."""
        return "nominal" in self.__dict__

    def but(self, **changed: Any) -> Self:
        """The same stage with other attributes; what has been computed stays as it is."""
        other = copy.copy(self)
        other.__dict__.update(changed)
        return other

    @cached_property
    def law(self) -> Law:
        """The stage's law: its own replaces the file's."""
        return self.spec.law or self.context.loaded.task.law

    @cached_property
    def limits(self) -> Limits:
        """The file's limits, with those of the stage put over them key by key."""
        common = self.context.loaded.task.limits
        if self.spec.limits is None:
            return common
        own = {k: v for k, v in self.spec.limits.model_dump().items() if v is not None}
        return common.model_copy(update=own)

    @cached_property
    def frame(self) -> FrameModel:
        """Its task frame."""
        return self.context.frames[self.spec.frame or self.context.loaded.task.frame]

    @cached_property
    def rotation(self) -> Vector:
        """(3, 3) its frame in the world at the start pose."""
        return frame_at_start(self.context, self.frame)

    @cached_property
    def lever(self) -> Vector:
        """(3,) from the tip to the control point at the start pose, world axes [m]."""
        return self.context.lever_of(self.frame)

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of its frame that the arm can move.

        Raises:
            SkewedAxisError: the frame is not aligned with the plane of a planar arm.
        """
        return existing_axes(self.context.robot.axes, self.rotation)

    @cached_property
    def path(self) -> PathShape | None:
        """Its path in SI units, on the axes that it drives.

        Raises:
            SpecError: the table cannot be read, or the path drives an axis that does not exist.
        """
        return path_shape(self.context, self.name, self.spec, self.axes)

    @cached_property
    def ready_path(self) -> PathShape | None:
        """Its path with the splines of a table laid, which takes a while."""
        return None if self.path is None else self.path.ready()

    @cached_property
    def contact(self) -> str | None:
        """The object that forces are taken to act on."""
        return self.context.contact_of(self.frame)

    def contact_of(self, axis: Axis) -> str | None:  # noqa: ARG002
        """The object that an axis presses on, or runs into."""
        return self.contact

    def normal_of(self, contact: str) -> Vector:
        """(3,) outward normal of an object where the stage meets it, world axes."""
        return self.context.start_normals[contact]

    @cached_property
    def gripped(self) -> bool:
        """Whether forces are returned by what the robot holds, and both ways."""
        return self.context.gripped(self.frame)

    @cached_property
    def held(self) -> str:
        """The mechanism whose handle returns forces instead of a contact; empty for none."""
        return self.context.held if self.gripped else ""

    @cached_property
    def stiffness(self) -> float:
        """Nominal stiffness [N/m] of what a force acts on, 0 without any."""
        if self.contact is not None:
            return self.context.compliances[self.contact].stiffness
        return GRIP.stiffness if self.gripped else 0.0

    @cached_property
    def moving_base(self) -> MovingBase | None:
        """How the object moves that carries its frame; None where none does."""
        return self.context.base_of(self.frame)

    @cached_property
    def plans(self) -> dict[Axis, AxisPlan]:
        """Who controls each of its axes."""
        normal = None
        if self.contact is not None:
            normal = self.rotation.T @ self.context.start_normals[self.contact]
        return plan_axes(self.axes, self.spec.axes, self.path, self.law, normal)

    @cached_property
    def active(self) -> tuple[str, ...]:
        """Names of the equations that constrain it."""
        return active_equations(self.law, self.spec, self.context.equations)

    @cached_property
    def couplings(self) -> dict[Axis, Coupling]:
        """How each axis that follows a mechanism does so.

        Raises:
            UncoupledError: the mechanism's geometry asks for no motion of an axis.
        """
        return {a: self.coupling_of(a) for a, plan in self.plans.items() if plan.mode == "follows"}

    def coupling_of(self, axis: Axis) -> Coupling:
        """How an axis follows its mechanism.

        Raises:
            UncoupledError: the mechanism's geometry asks for no motion of this axis.
        """
        return coupling(self.context, self.frame, self.rotation, self.plans, axis)

    @cached_property
    def plants(self) -> dict[Axis, AxisPlant]:
        """Mass and stiffness of each axis at the start pose, for gain design."""
        return self.context.plants(
            self.axes, self.rotation, self.environment, self.rates, self.lever
        )

    @cached_property
    def rates(self) -> Vector:
        """(3, 3) from angular velocity in the frame to the rates of the law's rotational rows."""
        return orientation.rates_of(self.law, self.rotation.T @ self.context.start_R)

    @cached_property
    def environment(self) -> dict[Axis, float]:
        """Nominal stiffness of the environment along and about each axis [N/m, N m/rad].

        A rotation meets a contact at the tool's radius. Along the way that a held mechanism leaves
        open there is none.
        """
        context = self.context
        if not self.gripped:
            reach = context.robot.tool.reach
            k = self.stiffness
            return {a: k * reach**2 if a.is_rotation else k for a in self.axes}
        open_ways = np.zeros((2, 3))
        if self.held:
            point = self.frame.origin if self.frame.at_origin else context.start_p
            open_ways = np.array(context.mechanisms[self.held].open_ways(point))
        found = {}
        for a in self.axes:
            axis = self.rotation[:, a.column]
            free = abs(float(axis @ open_ways[int(a.is_rotation)])) > MOSTLY
            k = GRIP.stiffness
            if a.is_rotation:
                k = GRIP.angular_stiffness + k * float(np.sum(np.cross(axis, self.lever) ** 2))
            found[a] = 0.0 if free else k
        return found

    @cached_property
    def gains(self) -> Gains:
        """Gains of its axes, of its equations and of the joints, with their origins."""
        gains = self.law.design({a: p.axis for a, p in self.plans.items()}, self.plants)
        context = self.context
        for gain, by in equation_gains(context, self.law, self.active, context.equations).items():
            gains.setdefault(gain, {}).update(by)
        if self.law.control_law.damps_joints:
            stiffness = [value_of(gains, "stiffness", a) + self._pressed(a) for a in self.axes]
            joints = context.joint_plants(self.axes, self.rotation, stiffness, self.rates)
            gains["joint_damping"] = self.law.design_joints(joints)
        return gains

    def _pressed(self, axis: Axis) -> float:
        """Stiffness of the contact that an axis presses on [N/m, N m/rad]; 0 where it does not."""
        return self.plants[axis].k if self.plans[axis].axis.has_force else 0.0

    def along(self, axis: Axis, direction: Vector) -> float:
        """Component of a direction (3,), world axes, along or about an axis at the start pose."""
        return float(self.rotation[:, axis.column] @ direction)

    @cached_property
    def translations(self) -> tuple[Axis, ...]:
        """Those of its axes that are translations."""
        return tuple(a for a in self.axes if not a.is_rotation)
