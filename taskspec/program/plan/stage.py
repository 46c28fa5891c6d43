"""A stage of a task, with what holds for it before any expression is built."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from functools import cached_property
from graphlib import TopologicalSorter
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.laws.disturbance import MomentumObserver
from taskspec.laws.gains import Gains, on_axis
from taskspec.modes import Coupling
from taskspec.motion.joint_path import JointPath
from taskspec.motion.path import PathShape
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.flow import leading_to
from taskspec.program.kept_forces import with_kept_forces
from taskspec.program.known_value import KnownValues
from taskspec.program.plan.contacts import StageContacts
from taskspec.program.plan.design import Design, DesignRules
from taskspec.program.plan.environment import StageEnvironment
from taskspec.program.plan.estimates import StageEstimates
from taskspec.program.plan.gain_range import GainRange
from taskspec.program.plan.kinematics import StageKinematics
from taskspec.program.plan.set_points import StageSetPoints
from taskspec.program.reference.axis_plan import AxisPlan, plan_axes, uncontrolled
from taskspec.program.reference.constraints import active_equations
from taskspec.program.reference.joint_motion import JointMotion
from taskspec.program.reference.path_share import least_share, nominal_share
from taskspec.program.reference.paths import by_phase, joint_path, path_shape
from taskspec.program.trajectory import Nominal
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.moving_base import MovingBase
from taskspec.spec import JOINT_LAWS, Adapt, Law, Limits, Stage, joint_law

Vector = NDArray[np.float64]

#: A weight below this is none [N m].
_NO_WEIGHT = 1e-3


class StagePlan:
    """What is decided about a stage: each thing once, when it is first asked for.

    Rules, analysis and compilation share it. What belongs together is a part of it: `kinematics`,
    `contacts`, `set_points`, `environment` and `design_rules`.

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
    def joint_path(self) -> JointPath | JointMotion | None:
        """Its path of joints; None where it is the axes of the tool that are controlled.

        Raises:
            SpecError: the joint positions are not those of the robot's joints.
        """
        return joint_path(self.context, self.name, self.spec)

    @cached_property
    def law(self) -> Law:
        """The stage's law: its own replaces the file's.

        A path of joints has one of its own, but where constraints are on it.
        """
        law = self.spec.law or self.context.loaded.task.law
        if self.spec.path is None or self.spec.path.joints is None:
            return law
        if self.spec.law is None and not active_equations(law, self.spec, self.context.equations):
            return joint_law(self.context.drives.commands, law)
        return law.model_copy(update={"orientation": "so3"})  # No axis turns by its angles.

    @cached_property
    def observer(self) -> MomentumObserver | None:
        """The disturbance observer beside its law; None without one."""
        declared, robot = self.law.disturbance_observer, self.context.robot
        if declared is None:
            return None
        most = MomentumObserver.limits(declared.torque, robot.torque_limit)
        return MomentumObserver(declared.bandwidth, self.context.period, most, tuple(robot.hinges))

    @cached_property
    def adapt(self) -> Adapt | None:
        """What its law adapts to, on a path of joints the file's; None for nothing."""
        return (self.spec.law or self.context.loaded.task.law).adapt

    @cached_property
    def adapts(self) -> bool:
        """Whether an estimate changes in it.

        A sensor at the wrist takes a payload and a contact for one: by it, a stage adapts that is
        to touch nothing.
        """
        return self.adapt is not None and not self.confuses_payload

    @property
    def confuses_payload(self) -> bool:
        """Whether forces that its sensor measures may be those of a payload and of contacts alike.

        So it is of a sensor at the wrist in a stage in the frame of an object, one that has a force
        or ends by one, one that follows such a stage, and where the tool is attached to something.
        """
        context, task = self.context, self.context.loaded.task
        if task.robot.sensor.at == "contact":
            return False
        attached = task.robot.grasp is not None or context.bushings or context.equations
        about = self.spec.contact is not None or self.contacts.surface is not None
        before = (task.stages[name] for name in leading_to(task.stages, self.name))
        ends = self.spec.ends_in_contact or any(stage.ends_in_contact for stage in before)
        return bool(attached or about or ends)

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
        if self.law.control_law.commands != "torque":
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
    def moving_base(self) -> MovingBase | None:
        """How the object moves that carries its frame; None where none does."""
        return self.context.base_of(self.frame)

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
        return nominal_share(self.context, self.spec, self.path, self.known)

    @cached_property
    def least_share(self) -> float:
        """What `path_share` never falls below, whatever the signals are."""
        return least_share(self.context, self.spec, self.path)

    # Its parts

    @cached_property
    def kinematics(self) -> StageKinematics:
        """Its frame and the arm in it, at the start pose and where the stage starts."""
        return StageKinematics(self.context, self.frame, self.law, self._at)

    @cached_property
    def contacts(self) -> StageContacts:
        """The objects that it presses on, runs into or holds."""
        return StageContacts(self.context, self.spec, self.frame, self.kinematics, self.known)

    @cached_property
    def set_points(self) -> StageSetPoints:
        """Its forces and torques, as far as the file tells what they are."""
        return StageSetPoints(self.spec, self.kinematics, self.known, self.longest)

    @cached_property
    def environment(self) -> StageEnvironment:
        """What returns forces on its axes."""
        return StageEnvironment(
            self.context,
            self.frame,
            self.kinematics,
            self.contacts,
            self.set_points,
            self.active,
        )

    @cached_property
    def design_rules(self) -> DesignRules:
        """What the rules of its law make of its gains."""
        return DesignRules(
            self.context,
            self.law,
            self.kinematics,
            self.contacts,
            self.environment,
            self.plans,
            self.active,
            self.moving_base,
            self.gain_range,
        )

    @cached_property
    def estimates(self) -> StageEstimates:
        """The contact stiffness that it estimates, and the gains that follow it."""
        return StageEstimates(
            self.context,
            self.law,
            self.frame,
            self.contacts,
            self.environment,
            self.design_rules,
            self.plans,
        )

    @cached_property
    def varying(self) -> tuple[tuple[str, str], ...]:
        """The gains that vary in it, by name and entry: by the file, or with what it estimates."""
        followed = [(name, on) for on, by in self.estimates.schedules.items() for name in by]
        return tuple(dict.fromkeys([*self.law.varying, *followed]))

    @cached_property
    def gain_range(self) -> GainRange:
        """The values of the expressions by which its gains vary."""
        return GainRange(self.context, self.spec, self.contacts.main, self.longest)

    # Its axes

    @property
    def rotation(self) -> Vector:
        """(3, 3) its frame in the world at the start pose."""
        return self.kinematics.rotation

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The axes of its frame that the arm can move.

        Raises:
            SkewedAxisError: the frame is not aligned with the plane of a planar arm.
        """
        return self.kinematics.axes

    @cached_property
    def translations(self) -> tuple[Axis, ...]:
        """Those of its axes that are translations."""
        return tuple(a for a in self.axes if not a.is_rotation)

    @cached_property
    def plans(self) -> dict[Axis, AxisPlan]:
        """Who controls each of its axes."""
        if self.joint_path is not None:
            return uncontrolled(self.axes)
        met = {a for a in self.axes if abs(self.contacts.facing(a)) > MOSTLY}
        return plan_axes(self.axes, self.spec.axes, self.path, self.law, met)

    @cached_property
    def from_rest(self) -> frozenset[Axis]:
        """Its axes whose expressions start from rest in a time of their own.

        None where a force or a velocity of the stage goes by the same t: the phase is kept.
        """
        if by_phase(self.spec):
            return frozenset()
        return frozenset(a for a, plan in self.plans.items() if plan.mode.own_time)

    @cached_property
    def met(self) -> tuple[str, ...]:
        """The objects along whose normal a motion gives way, that of the stage first."""
        found = {c for a, p in self.plans.items() if p.yields and (c := self.contacts.of(a))}
        return tuple(sorted(found, key=lambda c: c != self.contacts.main))

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

    @cached_property
    def leaders_first(self) -> tuple[Axis, ...]:
        """Its axes, each after those that it follows; those that follow nothing in their order.

        Raises:
            CycleError: axes follow each other.
        """
        leaders = {a: set(plan.mode.leaders) & self.plans.keys() for a, plan in self.plans.items()}
        for axis, coupling in self.couplings.items():
            leaders[axis] |= {coupling.leader} if coupling.leader is not None else set()
        return tuple(TopologicalSorter(leaders).static_order())

    def coupling_of(self, axis: Axis) -> Coupling | None:
        """How an axis follows its mechanism; None where it follows none.

        Raises:
            UncoupledError: the mechanism's geometry asks for no motion of this axis.
        """
        return self.plans[axis].mode.coupling(self, axis)

    @cached_property
    def known(self) -> KnownValues:
        """Values of expressions before a run."""
        return KnownValues(self.context)

    # Its gains

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
        if not self.contacts.held or self._choose is None or self.joint_path is not None:
            return self.by_rules()
        return self._choose(self)

    def by_rules(self) -> Design:
        """What the law's rules give."""
        if self.law.kind in JOINT_LAWS:
            return Design(JOINT_LAWS[self.law.kind].joint_gains(self.context.robot.n))
        if self.joint_path is not None:
            return self.design_rules.in_joints()
        return self.design_rules.design()

    def designed_as(self, design: Design) -> Self:
        """The same stage under another design."""
        return self.but(design=design, gains=design.gains, consistent=design.consistent)

    def spring_of(self, axis: Axis, mass: float | None = None) -> float:
        """Stiffness with which the law holds a motion axis to its reference [N/m, N m/rad].

        Args:
            axis: of the stage.
            mass: the law's inertia there [kg, kg m^2]; by default that of the arm along the axis.
        """
        h = self.design_rules.plants[axis].h if mass is None else mass
        return self.law.control_law.spring(on_axis(self.gains, axis), h)

    @property
    def falls(self) -> bool:
        """Whether nothing bears the arm's weight: neither its law nor a counterweight."""
        weight = float(np.abs(self.context.start_gravity).max(initial=0.0))
        return self.law.control_law.bare and weight > _NO_WEIGHT

    @property
    def torque_rates(self) -> Vector:
        """(n,) how fast each command may change [1/s of its unit]; infinite where nothing does.

        That is a torque [N m, N], or a velocity [rad/s, m/s] that a servo follows.
        """
        drives, n = self.context.drives, self.context.robot.n
        if not drives.torques:
            return drives.rates
        found = np.full(n, self.limits.torque_rate or np.inf)
        protection = self.context.loaded.task.robot.protection
        joints = None if protection is None else protection.joints
        if joints is not None and joints.torque_rate is not None:
            found = np.minimum(found, np.asarray(joints.torque_rate))
        return found
