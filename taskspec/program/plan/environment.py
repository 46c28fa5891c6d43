"""What the environment returns on the axes of a stage: contacts, grips, equations, bushings."""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.laws.servo_loop import Contact
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.plan.contacts import StageContacts
from taskspec.program.plan.kinematics import StageKinematics
from taskspec.program.plan.set_points import StageSetPoints
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.stiffness import GRIP, added_mass, contact_mobility
from taskspec.program.world.touch import whole_tool
from taskspec.shapes.solid import half_sizes, rounding, touched_whole

Vector = NDArray[np.float64]

#: What is left of a stiffness by rounding, as a share of the largest.
_ROUNDING = 1e-12


class StageEnvironment:
    """Nominal stiffness and damping of what a stage presses on, holds or is bound by."""

    def __init__(
        self,
        context: Context,
        frame: FrameModel,
        kinematics: StageKinematics,
        contacts: StageContacts,
        set_points: StageSetPoints,
        active: Collection[str],
    ) -> None:
        """Of a stage.

        Args:
            context: compliances, mechanisms and equations of the task.
            frame: of the stage.
            kinematics: its axes.
            contacts: what it presses on or holds.
            set_points: its forces.
            active: names of the equations that constrain it.
        """
        self._context, self._frame, self._kinematics = context, frame, kinematics
        self._contacts, self._set_points, self._active = contacts, set_points, active

    @cached_property
    def stiffness(self) -> float:
        """Nominal stiffness [N/m] of what the stage is about, 0 without any."""
        return self._stiffness(self._contacts.main)

    def returns(self, axis: Axis) -> Contact:
        """What returns a force along or about an axis where the run begins."""
        context, name = self._context, self._contacts.of(axis) or self.bearers.get(axis)
        step, k, d, m = 1.0 / context.loaded.task.control.plant_rate, self.by_axis[axis], 0.0, 0.0
        if self._contacts.gripped:
            d = self.grip_damping(axis) if k > 0 else 0.0
            m = d * step
        elif name is not None:
            reach = context.robot.tool.reach**2 if axis.is_rotation else 1.0
            d = context.compliances[name].damping * reach
            if (shape := context.loaded.task.shapes.get(name)) is not None:
                whole = whole_tool(context.robot.tool, context.surfaces[name]) is not None
                points = 1 if whole else len(context.robot.tool.radii)
                added = added_mass(contact_mobility(context.robot, shape))
                m = points * added * reach
        for bushing, J in self._bushing_rates.items():
            d += float(J[:, axis.row] @ context.bushings[bushing].damping @ J[:, axis.row])
        return Contact(k, d, m)

    def stiffness_of(self, axis: Axis) -> float:
        """Nominal stiffness of what acts on an axis [N/m], 0 without any.

        That of a contact, of the grip, and along the axis of bushings; about an axis that of these
        alone [N m/rad].
        """
        contact = self._contacts.of(axis) or self.bearers.get(axis)
        return (0.0 if axis.is_rotation else self._stiffness(contact)) + self._bushed(axis)

    @cached_property
    def bushings(self) -> Vector:
        """(6, 6) nominal stiffness of all bushings at the control point, in the stage's axes.

        As they are where the run begins [N/m, N/rad, N m/rad].
        """
        return sum(self._each_bushing.values(), np.zeros((6, 6)))

    def springs(self, axis: Axis) -> tuple[str, ...]:
        """The bushings that return anything along or about an axis."""
        return tuple(name for name, K in self._each_bushing.items() if K[axis.row].any())

    @cached_property
    def _each_bushing(self) -> dict[str, Vector]:
        found = {}
        for name, J in self._bushing_rates.items():
            K = J.T @ self._context.bushings[name].stiffness @ J
            found[name] = np.where(np.abs(K) > _ROUNDING * np.abs(K).max(), K, 0.0)
        return found

    @cached_property
    def _bushing_rates(self) -> dict[str, Vector]:
        """(6, 6) rates of each bushing's coordinates per twist of the control point."""
        context, kinematics = self._context, self._kinematics
        R = kinematics.rotation
        about = np.cross(kinematics.lever, R, axisb=0, axisc=0)
        moved = np.block([[R, about], [np.zeros((3, 3)), R]])
        return {
            name: model.spring(context.start_p, context.start_R).J @ moved
            for name, model in context.bushings.items()
        }

    def _bushed(self, axis: Axis) -> float:
        """Stiffness of the bushings along or about an axis [N/m, N m/rad]."""
        if not self._context.bushings:
            return 0.0
        return float(self.bushings[axis.row, axis.row])

    def _stiffness(self, contact: str | None) -> float:
        if contact is not None:
            return self._context.compliances[contact].stiffness
        return GRIP.stiffness if self._contacts.gripped else 0.0

    @cached_property
    def bearers(self) -> dict[Axis, str]:
        """The equation on the tip that returns the force of an axis, where no object does.

        An equation that constrains the stage is none: its force is a set point of its own.
        """
        if self._contacts.gripped or not self._context.equations:
            return {}
        alone = (axis for axis in self._contacts.forces if self._contacts.of(axis) is None)
        return {a: name for a in alone for name in self._context.equations if self._bears(name, a)}

    def _bears(self, equation: str, axis: Axis) -> bool:
        gradient = self._context.start_equations[equation].gradient
        if gradient is None or equation in self._active:
            return False
        along = self._kinematics.along(axis, gradient)
        # What the robot applies along the gradient is negative where >= is to hold, (4.125).
        side = {">=": -1, "<=": 1}.get(self._context.equations[equation].constraint.relation, 0)
        return abs(along) > MOSTLY and side * along * (self._set_points.of(axis) or 0.0) >= 0

    @cached_property
    def by_axis(self) -> dict[Axis, float]:
        """Nominal stiffness along and about each axis [N/m, N m/rad].

        A rotation meets a contact at the tool's radius. Along the way that a held mechanism leaves
        open there is none.
        """
        context, kinematics = self._context, self._kinematics
        if not self._contacts.gripped:
            reach = context.robot.tool.reach
            return {
                a: self._stiffness(self._contacts.of(a) or self.bearers.get(a)) * reach**2
                + self._bushed(a)
                if a.is_rotation
                else self.stiffness_of(a)
                for a in kinematics.axes
            }
        open_ways = np.zeros((2, 3))
        if self._contacts.held:
            point = self._frame.origin if self._frame.at_origin else context.start_p
            open_ways = np.array(context.mechanisms[self._contacts.held].open_ways(point))
        found = {}
        for a in kinematics.axes:
            axis = kinematics.rotation[:, a.column]
            free = abs(float(axis @ open_ways[int(a.is_rotation)])) > MOSTLY
            k = GRIP.stiffness
            if a.is_rotation:
                k = GRIP.angular_stiffness + k * float(
                    np.sum(np.cross(axis, kinematics.lever) ** 2)
                )
            found[a] = (0.0 if free else k) + self._bushed(a)
        return found

    def grip_damping(self, axis: Axis) -> float:
        """Damping of the grip along or about an axis at the control point [N s/m, N m s/rad]."""
        if not axis.is_rotation:
            return GRIP.damping
        about = np.cross(self._kinematics.rotation[:, axis.column], self._kinematics.lever)
        return GRIP.angular_damping + GRIP.damping * float(about @ about)

    @cached_property
    def face(self) -> float:
        """f r^2 / rounding of a flat tool, f the most that it presses with [N m/rad]; else 0."""
        contacts, context = self._contacts, self._context
        tool = context.robot.tool
        presses = [
            self._set_points.largest(a)
            for a in contacts.forces
            if (name := contacts.of(a)) and touched_whole(context.surfaces[name])
        ]
        sizes = half_sizes(tool.solid)
        if not (tool.flat and presses and sizes) or contacts.gripped:
            return 0.0
        return max(presses) * tool.reach**2 / rounding(sizes[1])
