"""A stage of a task, with what holds for it before any expression is built."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.laws.computed_torque import COMPUTED_TORQUE
from taskspec.laws.gains import AxisPlant, Gains, on_axis, value_of
from taskspec.laws.mechanism_form import damping_rate
from taskspec.modes import Coupling
from taskspec.motion.joint_path import JointPath
from taskspec.motion.path import PathShape
from taskspec.program.axes import MOSTLY, existing_axes
from taskspec.program.contacts import Encounter, directions
from taskspec.program.context import Context
from taskspec.program.kept_forces import with_kept_forces
from taskspec.program.known_value import KnownValues
from taskspec.program.prepare import frame_at_start, prepare
from taskspec.program.reference import orientation
from taskspec.program.reference.axis_plan import AxisPlan, plan_axes, uncontrolled
from taskspec.program.reference.constraints import active_equations, equation_gains
from taskspec.program.reference.path_share import least_share, nominal_share
from taskspec.program.reference.paths import joint_path, path_shape
from taskspec.program.trajectory import Nominal
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.program.world.stiffness import GRIP
from taskspec.shapes.solid import half_sizes, rounding, touched_whole
from taskspec.spec import JOINT_LAW, AxisEntry, Law, Limits, Stage
from taskspec.text.expression import Expression

Vector = NDArray[np.float64]

#: From here on J H^-1 J^T counts as singular.
_CONDITION = 1e12
#: A weight below this is none [N m].
_NO_WEIGHT = 1e-3
#: Cosine from which on two normals are taken as one: 1 deg.
_SAME = float(np.cos(np.deg2rad(1.0)))
#: How long a set point that depends on time is followed where its stage has no bound [s], and at
#: how many instants.
_FOLLOWED, _INSTANTS = 10.0, 201


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


class StagePlan:
    """What is decided about a stage: each thing once, when it is first asked for.

    Checks, predictions, analysis and compilation share it.

    Attributes:
        context: robot, start, frames and surfaces of the task.
        name: of the stage.
        spec: its entry in the file.
        nominal: its nominal trajectory; set by the plan of the task as that follows it.
        unheeded: names of the limits that do not end it: what comes after them is of interest.
    """

    context: Context
    name: str
    spec: Stage
    nominal: Nominal
    unheeded: frozenset[str] = frozenset()

    def __init__(
        self,
        context: Context,
        name: str,
        at: Callable[[], tuple[Vector, Vector]] | None = None,
        choose: Callable[[StagePlan], Design] | None = None,
    ) -> None:
        """A stage of a task.

        Args:
            context: robot, start, frames and surfaces of the task.
            name: of the stage.
            at: where the tip is as the stage starts, asked when that is first needed; None for
                the start pose.
            choose: knows the best design on a held mechanism; None for what the rules give.
        """
        self._choose = choose
        self.context, self.name = context, name
        self.spec = with_kept_forces(context, name)
        self._at = at
        self._met: dict[Axis, Encounter] = {}
        self._normals: dict[str, Vector] = {}

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
    def joint_path(self) -> JointPath | None:
        """Its path of joints; None where it is the axes of the tool that are controlled.

        Raises:
            SpecError: the joint positions are not those of the robot's joints.
        """
        return joint_path(self.context, self.name, self.spec)

    @cached_property
    def law(self) -> Law:
        """The stage's law: its own replaces the file's, and a path of joints has but one."""
        if self.spec.path is not None and self.spec.path.joints is not None:
            return JOINT_LAW
        return self.spec.law or self.context.loaded.task.law

    @cached_property
    def limits(self) -> Limits:
        """The file's limits, with those of the stage put over them key by key.

        What keeps limits keeps the rate of torques that the robot's protection has as well.
        """
        limits = self.context.loaded.task.limits_of(self.spec)
        protection = self.context.loaded.task.robot.protection
        joints = None if protection is None else protection.joints
        if self.law.solve != "qp" or joints is None or joints.torque_rate is None:
            return limits
        rates = [*joints.torque_rate, limits.torque_rate or math.inf]
        return limits.model_copy(update={"torque_rate": min(rates)})

    @cached_property
    def longest(self) -> float:
        """The time after which it has ended whatever happens [s]; infinite where none is stated."""
        spec = self.spec
        bound = spec.time if spec.within is None else spec.within.time
        return math.inf if bound is None else bound + self.context.period

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
        frame, context = self.frame, self.context
        if not frame.at_origin:
            return np.zeros(3)
        if frame.kind == "tool":
            return np.asarray(context.start_R @ frame.origin)
        return np.asarray(context.placed(frame)[1] - context.start_p)

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
    def path_share(self) -> float:
        """How fast its path's time goes at nominal signals: 1, but where signals slow it."""
        return nominal_share(self.context, self.spec, self.path, self._known_values)

    @cached_property
    def least_share(self) -> float:
        """What `path_share` never falls below, whatever the signals are."""
        return least_share(self.context, self.spec, self.path)

    @cached_property
    def surface(self) -> str | None:
        """The object that its frame follows or is fixed on, and that its forces then act on."""
        owner = self.frame.surface_name or self.frame.owner
        here = owner in self.context.surfaces and owner != self.context.loaded.task.robot.grasp
        return owner if here else None

    @cached_property
    def contacts(self) -> dict[Axis, str | None]:
        """The object that each translation presses on, or runs into."""
        return {a: self._contact_along(a) for a in self.axes if not a.is_rotation}

    def contact_of(self, axis: Axis) -> str | None:
        """The object that an axis presses on, or runs into; else that which the stage is about.

        What the tool touches also acts on axes along which it lies in nobody's way: by friction,
        and by its moments.
        """
        own = self.contacts.get(axis)
        if own is None and axis.is_rotation:
            entry = self.spec.axes.get(axis)
            own = None if entry is None else entry.contact
        return own or self.contact

    @cached_property
    def contact(self) -> str | None:
        """The object that the stage is about: the stiffest that it presses on, or what it meets."""
        named = self.spec.contact or self.surface
        if named is not None or self.gripped:
            return named
        if self.force_contacts:
            return max(self.force_contacts, key=lambda c: self.context.compliances[c].stiffness)
        if self.approached is not None:
            return self.approached
        near = [self._met[a] for a in self.contacts if a in self._met]
        if near:
            return min(near, key=lambda met: met.way).contact
        return next((c for c in self.contacts.values() if c is not None), None)

    @cached_property
    def gap_contact(self) -> str | None:
        """The object that `gap` is the distance from; None where its forces have several."""
        return None if len(self.force_contacts) > 1 else self.contact

    @cached_property
    def force_contacts(self) -> tuple[str, ...]:
        """The objects that its forces press on, each once, by the order of their axes."""
        contacts = (self.contacts[a] for a in self.forces)
        return tuple(dict.fromkeys(c for c in contacts if c is not None))

    @cached_property
    def approached(self) -> str | None:
        """The first object on the way of its steady velocities; None where there is none."""
        if self.surface is not None or self.spec.contact is not None or self.gripped:
            return self.contact
        rates = np.zeros(3)
        for axis, entry in self.spec.axes.items():
            if axis in self.contacts:
                rates[axis.row] = entry.mode.settled_rate(self.known) or 0.0
        if not np.isfinite(rates).all() or not rates.any():
            return None
        p, R = self.tool
        way = self.frame_at_tool @ rates
        speed = np.linalg.norm(way)
        # The squares of what is hardly a number are none.
        met = self.context.obstacles.first(p, R, way / speed) if speed > 0 else None
        if met is None:
            return None
        self._normals.setdefault(met.contact, met.normal)
        return met.contact

    @cached_property
    def forces(self) -> tuple[Axis, ...]:
        """Its translations with a force set point."""
        entries = self.spec.axes
        return tuple(a for a in self.contacts if a in entries and entries[a].has_force)

    @cached_property
    def tool(self) -> tuple[Vector, Vector]:
        """(3,), (3, 3) where the tip is expected to be as the stage starts, world axes."""
        return (self.context.start_p, self.context.start_R) if self._at is None else self._at()

    @cached_property
    def frame_at_tool(self) -> Vector:
        """(3, 3) its frame as the stage starts, if that turns with the tool; else at the start."""
        return self.tool[1] @ self.frame.rotation if self.frame.kind == "tool" else self.rotation

    def _contact_along(self, axis: Axis) -> str | None:
        entry = self.spec.axes.get(axis)
        named = (entry.contact if entry is not None else None) or self.spec.contact
        if named is not None or self.gripped:
            return named
        if self.surface is not None:
            normal = self.context.start_normals[self.surface]
            across = abs(float(self.rotation[:, axis.column] @ normal)) < MOSTLY
            if not (across and entry is not None and entry.has_force):
                return self.surface
            # A force along the surface is returned by what stands on it.
        met = self._ahead(axis, entry)
        if met is None:
            return self.surface
        self._met[axis] = met
        self._normals.setdefault(met.contact, met.normal)
        return met.contact

    def _ahead(self, axis: Axis, entry: AxisEntry | None) -> Encounter | None:
        """The first object that an axis leads to."""
        p, R = self.tool
        way = self.frame_at_tool[:, axis.column]
        for signs in directions(entry, self.known):
            met = [self.context.obstacles.first(p, R, sign * way) for sign in signs]
            nearest = min((m for m in met if m is not None), key=lambda m: m.way, default=None)
            if nearest is not None:
                return nearest
        return None

    def normal_of(self, contact: str) -> Vector:
        """(3,) outward normal of an object where the stage meets it, world axes."""
        context = self.context
        at_start = context.start_normals[contact]
        if contact == self.surface:
            return at_start
        if contact not in self._normals:
            self._normals[contact] = context.obstacles.normal(contact, *self.tool)
        normal = self._normals[contact]
        return at_start if float(normal @ at_start) > _SAME else normal

    def along(self, axis: Axis, direction: Vector) -> float:
        """Component of a direction (3,), world axes, along an axis at the start pose."""
        return float(self.rotation[:, axis.column] @ direction)

    def facing(self, axis: Axis) -> float:
        """Component of an axis along the outward normal of its contact; 0 without one."""
        contact = self.contact_of(axis)
        if contact is None or axis.is_rotation:
            return 0.0
        return self.along(axis, self.normal_of(contact))

    @cached_property
    def gripped(self) -> bool:
        """Whether forces are returned by what the robot holds, and both ways.

        A handle returns them in every frame but those of an object; a loose body where the world
        has no other object.
        """
        context = self.context
        if context.loaded.task.robot.grasp is None or self.surface is not None:
            return False
        return bool(context.held) or not context.touchable_gaps

    @cached_property
    def held(self) -> str:
        """The mechanism whose handle returns forces instead of a contact; empty for none."""
        return self.context.held if self.gripped else ""

    @cached_property
    def stiffness(self) -> float:
        """Nominal stiffness [N/m] of what the stage is about, 0 without any."""
        return self._stiffness(self.contact)

    def stiffness_of(self, axis: Axis) -> float:
        """Nominal stiffness [N/m] of what a force on an axis acts on, 0 without any."""
        return self._stiffness(self.contact_of(axis) or self.bearers.get(axis))

    def spring_of(self, axis: Axis, mass: float | None = None) -> float:
        """Stiffness with which the law holds a motion axis to its reference [N/m, N m/rad].

        Args:
            axis: of the stage.
            mass: the law's inertia there [kg, kg m^2]; by default that of the arm along the axis.
        """
        h = self.plants[axis].h if mass is None else mass
        return self.law.control_law.spring(on_axis(self.gains, axis), h)

    @cached_property
    def bearers(self) -> dict[Axis, str]:
        """The equation on the tip that returns the force of an axis, where no object does.

        An equation that constrains the stage is none: its force is a set point of its own.
        """
        if self.gripped or not self.context.equations:
            return {}
        alone = (axis for axis in self.forces if self.contact_of(axis) is None)
        return {a: name for a in alone for name in self.context.equations if self._bears(name, a)}

    def _bears(self, equation: str, axis: Axis) -> bool:
        gradient = self.context.start_equations[equation].gradient
        if gradient is None or equation in self.active:
            return False
        along = self.along(axis, gradient)
        # What the robot applies along the gradient is negative where >= is to hold, (4.125).
        side = {">=": -1, "<=": 1}.get(self.context.equations[equation].constraint.relation, 0)
        return abs(along) > MOSTLY and side * along * (self.set_point_of(axis) or 0.0) >= 0

    def _stiffness(self, contact: str | None) -> float:
        if contact is not None:
            return self.context.compliances[contact].stiffness
        return GRIP.stiffness if self.gripped else 0.0

    @cached_property
    def moving_base(self) -> MovingBase | None:
        """How the object moves that carries its frame; None where none does."""
        return self.context.base_of(self.frame)

    @cached_property
    def plans(self) -> dict[Axis, AxisPlan]:
        """Who controls each of its axes."""
        if self.joint_path is not None:
            return uncontrolled(self.axes)
        met = {a for a in self.axes if abs(self.facing(a)) > MOSTLY}
        return plan_axes(self.axes, self.spec.axes, self.path, self.law, met)

    @cached_property
    def from_rest(self) -> frozenset[Axis]:
        """Its axes whose expressions start from rest in a time of their own.

        None where a force or a velocity of the stage goes by the same t: the phase is kept.
        """
        spec = self.spec
        others = [entry.set_point.wanted for entry in spec.axes.values() if entry.set_point]
        others += [point.wanted for point in spec.constraints.values()]
        for entry in spec.axes.values():
            others += [e for e, place in entry.mode.expressions() if not place]
        if any(expression.uses("t") for expression in others):
            return frozenset()
        return frozenset(a for a, plan in self.plans.items() if plan.mode.own_time)

    @cached_property
    def objects(self) -> tuple[str, ...]:
        """All objects that its axes press on or may run into."""
        found = [c for a in self.axes if (c := self.contact_of(a)) is not None]
        return tuple(dict.fromkeys(found))

    @cached_property
    def touched(self) -> tuple[str, ...]:
        """The objects that it touches: that which it is about, then those of its other forces."""
        first = () if self.contact is None else (self.contact,)
        others = (c for a in self.forces if (c := self.contacts[a]) is not None)
        return tuple(dict.fromkeys((*first, *others)))

    @cached_property
    def pressed(self) -> frozenset[str]:
        """Those of them along whose normal a force acts."""
        along = (a for a in self.forces if abs(self.facing(a)) > MOSTLY)
        return frozenset(c for a in along if (c := self.contacts[a]) is not None)

    @cached_property
    def met(self) -> tuple[str, ...]:
        """The objects along whose normal a motion gives way, that of the stage first."""
        found = {c for a, p in self.plans.items() if p.yields and (c := self.contact_of(a))}
        return tuple(sorted(found, key=lambda c: c != self.contact))

    @cached_property
    def set_points(self) -> dict[Axis, float]:
        """Forces and torques of its axes that are constant and not zero [N, N m]."""
        found = {}
        for axis in self.spec.axes:
            value = self.set_point_of(axis)
            if value:
                found[axis] = value
        return found

    def set_point_of(self, axis: Axis) -> float | None:
        """Force along an axis, or torque about it, where the text of the file tells it [N, N m].

        None where it depends on time or signals, and on axes without one or that do not exist.
        """
        entry = self.spec.axes.get(axis) if axis in self.axes else None
        force = None if entry is None else entry.set_point
        return None if force is None else self.known(force.wanted)

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
        return {a: c for a in self.plans if (c := self.coupling_of(a)) is not None}

    def coupling_of(self, axis: Axis) -> Coupling | None:
        """How an axis follows its mechanism; None where it follows none.

        Raises:
            UncoupledError: the mechanism's geometry asks for no motion of this axis.
        """
        return self.plans[axis].mode.coupling(self, axis)

    def known(
        self, expression: Expression, clocks: Mapping[str, float] | None = None
    ) -> float | None:
        """What an expression is worth before a run; see `KnownValues`."""
        return self._known_values(expression, clocks)

    @cached_property
    def _known_values(self) -> KnownValues:
        return KnownValues(self.context)

    @cached_property
    def plants(self) -> dict[Axis, AxisPlant]:
        """Mass and stiffness of each axis at the start pose, for gain design."""
        mobility = self._mobility
        if np.linalg.cond(mobility) > _CONDITION:
            # The run stops before its first tick; that it is said needs gains that are finite.
            mobility = mobility + np.eye(len(self._rows)) / _CONDITION
        held, period = np.diag(np.linalg.inv(mobility)), self.context.period
        return {
            a: AxisPlant(
                h=1.0 / mobility[i, i],
                held=held[i],
                k=self.environment[a],
                period=period,
                grip=self._grip_damping(a) if self.held else None,
                face=self._face if a.is_rotation else 0.0,
            )
            for i, a in enumerate(self.axes)
        }

    @cached_property
    def _face(self) -> float:
        """f r^2 / rounding of a flat tool, f the most that it presses with [N m/rad]; else 0."""
        tool = self.context.robot.tool
        presses = [
            self._most_of(a)
            for a in self.forces
            if (name := self.contact_of(a)) and touched_whole(self.context.surfaces[name])
        ]
        sizes = half_sizes(tool.solid)
        if not (tool.flat and presses and sizes) or self.gripped:
            return 0.0
        return max(presses) * tool.reach**2 / rounding(sizes[1])

    def _most_of(self, axis: Axis) -> float:
        """The largest size of a set point that is constant or depends on time alone, else 0 [N]."""
        entry = self.spec.axes[axis].set_point
        if entry is None:
            return 0.0
        lasts = min(self.longest, _FOLLOWED)
        values = [
            self.known(entry.wanted, {"t": float(t)}) for t in np.linspace(0.0, lasts, _INSTANTS)
        ]
        return max((abs(v) for v in values if v is not None and math.isfinite(v)), default=0.0)

    def _grip_damping(self, axis: Axis) -> float:
        """Damping of the grip along or about an axis at the control point."""
        if not axis.is_rotation:
            return GRIP.damping
        about = np.cross(self.rotation[:, axis.column], self.lever)
        return GRIP.angular_damping + GRIP.damping * float(about @ about)

    @property
    def _mobility(self) -> Vector:
        """(m, m) J H^-1 J^T of its axes at the start pose."""
        J = self.jacobian[self._rows]
        return np.asarray(J @ np.linalg.solve(self.context.start_inertia, J.T))

    @property
    def mobility(self) -> Vector:
        """(6, 6) J H^-1 J^T of its axes at the start pose, 0 on others [1/kg, 1/(kg m^2)]."""
        found = np.zeros((6, 6))
        found[np.ix_(self._rows, self._rows)] = self._mobility
        return found

    @property
    def task_inertia(self) -> Vector:
        """(6, 6) (J H^-1 J^T)^-1 of its axes at the start pose, 0 on others [kg, kg m^2]."""
        found = np.zeros((6, 6))
        found[np.ix_(self._rows, self._rows)] = np.linalg.inv(self._mobility)
        return found

    @property
    def cancels_late(self) -> float:
        """How much larger, every tick, the grip's damping makes what a law takes off too late.

        rho(T (M - S_y M_yy S_y^T) D_g) at the start pose, with M = J H^-1 J^T, the axes y that give
        way, and the damping D_g of the grip: a law that selects takes the measured force off all
        but the block of these. From 1 on it flips from tick to tick, whatever its gains. 0 for a
        law that does not select, and where nothing is held.
        """
        if not (self.held and self.law.control_law.selects):
            return 0.0
        late, context = self._mobility, self.context
        yielding = [i for i, p in enumerate(self.plans.values()) if p.force or p.soft]
        late[np.ix_(yielding, yielding)] = 0.0
        # Twist of the tip, world axes, per rates of the axes.
        J = np.kron(np.eye(2), self.rotation)
        J[:3, 3:] = np.cross(self.lever, self.rotation, axisb=0, axisc=0)
        J, turned = J[:, self._rows], context.mechanisms[self.held].rotation[:, 2]
        grip = np.diag([GRIP.damping] * 3 + [GRIP.angular_damping] * 3)
        if context.mechanisms[self.held].free:
            grip[3:, 3:] -= GRIP.angular_damping * np.outer(turned, turned)
        return float(np.max(np.abs(np.linalg.eigvals(context.period * late @ (J.T @ grip @ J)))))

    @property
    def _rows(self) -> list[int]:
        return [a.row for a in self.axes]

    @property
    def jacobian(self) -> Vector:
        """(6, n) of the control point at the start pose, its rows those of the law."""
        J = self.context.start_jacobian.copy()
        J[:3] += np.cross(J[3:], self.lever, axis=0)
        return self._resolved(J)

    def _resolved(self, J: Vector) -> Vector:
        return np.vstack([self.rotation.T @ J[:3], self.rates @ self.rotation.T @ J[3:]])

    def _joint_plants(self, stiffness: list[float]) -> list[AxisPlant]:
        """Inertia and stiffness about each joint at the start pose.

        Args:
            stiffness: of spring and contact together, on the axes [N/m, N m/rad].
        """
        context = self.context
        J = self._resolved(context.start_jacobian)[self._rows]
        about = np.einsum("ij,i,ij->j", J, stiffness, J)
        free = 1.0 / np.diag(np.linalg.inv(context.start_inertia))
        held = np.diag(context.start_inertia)
        return [
            AxisPlant(h=free[j], held=held[j], k=about[j], period=context.period)
            for j in range(len(held))
        ]

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
            return {
                a: self.stiffness_of(a) * reach**2 if a.is_rotation else self.stiffness_of(a)
                for a in self.axes
            }
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
        return self.design.gains

    @cached_property
    def consistent(self) -> bool:
        """Whether its law takes the form for a held mechanism."""
        return self.design.consistent

    @cached_property
    def design(self) -> Design:
        """Form and gains of its law; on a held mechanism those that the sampled loop is best with.

        Without anything that knows the loop, the law's own form and what its rules give.
        """
        if not self.held or self._choose is None or self.joint_path is not None:
            return self.by_rules()
        return self._choose(self)

    @property
    def has_mechanism_form(self) -> bool:
        """Whether its law has a form for the mechanism that it holds, seen as its frame does."""
        law = self.law
        fits = law.control_law.mechanism_form and law.orientation == "so3" and not self.active
        return bool(self.held) and fits and self.moving_base is None

    def by_rules(self, *, consistent: bool = False) -> Design:
        """What the law's rules give.

        Args:
            consistent: whether it takes the form for a held mechanism.
        """
        if self.joint_path is not None:
            return Design(COMPUTED_TORQUE.joint_gains(self.context.robot.pin.nv))
        plants = self.plants
        if consistent:
            rate = damping_rate(self.context.period)
            plants = {a: replace(plant, damper=rate * plant.held) for a, plant in plants.items()}
        gains = self.law.design({a: p.axis for a, p in self.plans.items()}, plants)
        context = self.context
        for gain, by in equation_gains(context, self.law, self.active, context.equations).items():
            gains.setdefault(gain, {}).update(by)
        if self.law.control_law.damps_joints:
            stiffness = [value_of(gains, "stiffness", a) + self._pressed(a) for a in self.axes]
            joints = self._joint_plants(stiffness)
            gains["joint_damping"] = self.law.design_joints(joints)
        return Design(gains, consistent)

    def designed_as(self, design: Design) -> Self:
        """The same stage under another design."""
        return self.but(design=design, gains=design.gains, consistent=design.consistent)

    def _pressed(self, axis: Axis) -> float:
        """Stiffness of the contact that an axis presses on [N/m, N m/rad]; 0 where it does not."""
        return self.plants[axis].k if self.plans[axis].set_point else 0.0

    @property
    def falls(self) -> bool:
        """Whether nothing bears the arm's weight: neither its law nor a counterweight."""
        weight = float(np.abs(self.context.start_gravity).max(initial=0.0))
        return self.law.control_law.bare and weight > _NO_WEIGHT

    @cached_property
    def translations(self) -> tuple[Axis, ...]:
        """Those of its axes that are translations."""
        return tuple(a for a in self.axes if not a.is_rotation)


class Walk(Protocol):
    """What tells where the tool goes, stage after stage."""

    @property
    def tool(self) -> tuple[Vector, Vector]:
        """(3,), (3, 3) where the tip is last known to be, world axes."""

    def stage(self, stage: StagePlan) -> Nominal:
        """The nominal trajectory of the stage that comes next in the file."""


class TaskPlan:
    """A task with the plans of its stages.

    Attributes:
        context: robot, start, frames and surfaces.
        stages: by name, in the order of the file.
        framed: those of them whose frame is known to have axes as the run begins; they are entered
            as the task is examined.
        loops: the sampled loops of stages that were analysed, by name.
        courses: of their forces, once they were asked for.
        compiled: their functions, once they were asked for, by name.
    """

    def __init__(
        self,
        context: Context,
        walk: Callable[[Context], Walk],
        choose: Callable[[StagePlan], Design] | None = None,
    ) -> None:
        """The plans of the stages of a task.

        Args:
            context: robot, start, frames and surfaces.
            walk: makes what tells where the tool goes, from the start pose on.
            choose: knows the best design of a stage that holds a mechanism.
        """
        self.context, self._choose = context, choose
        self._walk_from_start, self._walk = walk, walk(context)
        self.stages: Mapping[str, StagePlan] = {
            name: StagePlan(at, name, self._tool, choose) for name, at in _contexts(context)
        }
        self.framed: dict[str, StagePlan] = {}
        self.loops: dict[str, Any] = {}
        self.courses: tuple[Any, ...] = ()
        self.compiled: dict[str, Any] = {}

    def unvaried(self) -> TaskPlan:
        """The plan of the same task with nothing that varies."""
        loaded = self.context.loaded
        alone = loaded.task.model_copy(update={"vary": {}})
        context = replace(self.context, loaded=replace(loaded, task=alone))
        return TaskPlan(context, self._walk_from_start, self._choose)

    def _tool(self) -> tuple[Vector, Vector]:
        return self._walk.tool

    def follow(self, name: str) -> StagePlan:
        """A stage with its nominal trajectory, which goes on from that of the last one followed.

        Args:
            name: of the stage; stages are followed in the order of the file.
        """
        stage = self.stages[name]
        if not stage.followed:
            # Where the stage starts is known now: the walk goes on from there.
            stage.tool = self._walk.tool
            stage.nominal = self._walk.stage(stage)
        return stage


def _contexts(context: Context) -> Iterator[tuple[str, Context]]:
    """Each stage in the order of the file, with the arm from which its law is designed.

    That is the arm at the start of the run, and after a path of joints the arm at its end: gains,
    stability and what is near count from where the tool works, not from where it was folded.
    """
    for name, spec in context.loaded.task.stages.items():
        yield name, context
        path = spec.path
        if path is None or path.joints is None:
            continue
        target = path.joints[-1]
        # What does not fit the arm is for the rules to say.
        if len(target) == context.robot.pin.nv:
            context = prepare(context.loaded, context.robot, np.array(target, dtype=float))
