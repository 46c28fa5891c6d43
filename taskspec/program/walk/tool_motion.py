"""Motion of the tool by the references of a stage: along a frame, over a surface, with a mechanism.

Each takes the tool from one pose to the next as the references move on, `advance`, and knows the
axes of the frame there. Where it cannot take it any farther, `left` names what ended.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

import casadi as ca
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.modes import Follows
from taskspec.program.axes import MOSTLY
from taskspec.program.bound import BoundFunction
from taskspec.program.passage import Stopped, Strain
from taskspec.program.plan import StagePlan
from taskspec.program.prepare import chart_at
from taskspec.program.walk.held_drive import held_drive
from taskspec.program.walk.held_motion import resolved_twists
from taskspec.program.world.stiffness import GRIP

Vector = NDArray[np.float64]

#: The tool is drawn back by this along its force to see what is ahead of it [m].
_BACK = 5e-3
#: Where nothing is ahead nearer than this, the tool has left what it pressed on [m].
_LOST = 20e-3
#: A reference whose rate changes by less than this share from one point to the next is steady.
_STEADY = 0.02


class ToolMotion(Protocol):
    """The surface or frame along which references carry the tool.

    Attributes:
        p, R: (3,), (3, 3) pose of the tip, world axes.
        frame: (3, 3) axes of the stage's frame there.
        left: name of what it does not follow any farther; empty while it does.
    """

    p: Vector
    R: Vector
    frame: Vector
    left: str

    def advance(self, time: float, moved: Mapping[Axis, float]) -> None:
        """Go on.

        Args:
            time: since the stage began [s].
            moved: displacement of the references since then [m, rad].
        """


class Straight:
    """A frame that stands still, or turns with the tool."""

    def __init__(self, stage: StagePlan, p: Vector, R: Vector) -> None:
        self.p, self.R, self.frame, self.left = p, R, stage.kinematics.frame_at_tool, ""
        self._stage, self._moved = stage, np.zeros(6)
        self._own = stage.frame.rotation if stage.frame.kind == "tool" else None
        if self._own is not None:
            self.frame = R @ self._own
        self._lever = R.T @ _lever(stage, p, R)
        self._pressed = _pressed_on(stage)

    def advance(self, time: float, moved: Mapping[Axis, float]) -> None:  # noqa: ARG002
        """Along the frame's axes, about the control point."""
        at = np.array([moved[a] for a in AXES])
        d, self._moved = at - self._moved, at
        point = self.p + self.R @ self._lever + self.frame @ d[:3]
        if d[3:].any():
            self.R = pin.exp3(self.frame @ d[3:]) @ self.R
        self.p = point - self.R @ self._lever
        if self._own is not None:
            self.frame = self.R @ self._own
        if self._pressed is not None:
            self._settle(*self._pressed)

    def _settle(self, contact: str, axis: Axis, sign: float) -> None:
        """Stay on what the stage presses on, whose normal is not the same everywhere."""
        direction = sign * self.frame[:, axis.column]
        obstacles = self._stage.context.obstacles
        met = obstacles.first(self.p - _BACK * direction, self.R, direction)
        if met is None or met.travel > _BACK + _LOST:
            self.left = contact
        else:
            self.p = self.p + (met.travel - _BACK) * direction


def _lever(stage: StagePlan, p: Vector, R: Vector) -> Vector:
    """(3,) from the tip to the control point, world axes [m]."""
    frame = stage.frame
    if not frame.at_origin:
        return np.zeros(3)
    if frame.kind == "tool":
        return np.asarray(R @ frame.origin)
    return np.asarray(stage.context.placed(frame)[1] - p)


def _pressed_on(stage: StagePlan) -> tuple[str, Axis, float] | None:
    """The object that may end under the tool, the axis that presses on it, and its sign."""
    if len(stage.contacts.forces) != 1 or not stage.frame.still:
        return None
    (axis,) = stage.contacts.forces
    contact, value = stage.contacts.by_axis[axis], stage.set_points.of(axis)
    if contact is None or not value or contact in stage.context.moving_bases:
        return None
    shape = stage.context.loaded.task.shapes.get(contact)
    if shape is None or shape.gives_way or stage.context.surfaces[contact].level:
        return None
    if value * stage.contacts.facing(axis) > 0 or abs(stage.contacts.facing(axis)) < MOSTLY:
        return None
    return contact, axis, math.copysign(1.0, value)


class OnSurface:
    """A frame that follows a surface: lengths along it, the tool turning with its normal."""

    def __init__(self, stage: StagePlan, p: Vector, R: Vector) -> None:
        frame, context = stage.frame, stage.context
        assert frame.surface is not None
        self.p, self.R, self.left = p, R, ""
        self._name, self._moved = frame.surface_name, np.zeros(6)
        tool = context.robot.tool
        self._center = np.zeros(3) if tool.flat else tool.centers[0]
        center = p + R @ self._center
        chart, x = chart_at(frame.surface, center), ca.SX.sym("x", 3)
        foot = chart.foot(x)
        outputs = [chart.frame(x, frame.heading), foot, chart.margin(x, frame.heading)]
        at = ca.Function("at", [x], [ca.densify(each) for each in outputs])
        self._here, self._outputs = np.zeros(3), [np.empty(n) for n in (9, 3, 1)]
        self._at = BoundFunction(at, [self._here], self._outputs)
        self.frame, foot_at, _ = self._look(center)
        self._foot = foot_at
        self._height = float(self.frame[:, 2] @ (center - foot_at))

    def _look(self, center: Vector) -> tuple[Vector, Vector, float]:
        self._here[:] = center
        self._at.evaluate()
        axes, foot, margin = self._outputs
        return axes.reshape(3, 3).T.copy(), foot.copy(), float(margin[0])

    def advance(self, time: float, moved: Mapping[Axis, float]) -> None:  # noqa: ARG002
        """Moves the tool on along the surface."""
        at = np.array([moved[a] for a in AXES])
        d, self._moved = at - self._moved, at
        height = self._height + moved[Axis.Z]
        # A step of two halves keeps to the length on a curved surface.
        for _ in range(2):
            ahead = self._foot + self.frame[:, :2] @ d[:2] / 2
            before = self.frame
            self.frame, self._foot, margin = self._look(ahead + height * self.frame[:, 2])
            turn = self.frame @ pin.exp3(d[3:] / 2) @ before.T
            self.R = turn @ self.R
            if not margin > 0:
                self.left = self._name
        self.p = self._foot + height * self.frame[:, 2] - self.R @ self._center


@dataclass(frozen=True, slots=True)
class _Point:
    """Time [s], coordinate [rad, m] and displacement of the references at one point of the path."""

    time: float
    coordinate: float
    moved: Mapping[Axis, float]


class WithMechanism:
    """A tool that holds a mechanism, and what its references make of the coordinate.

    The mechanism moves by the s that presses least: it minimises sum k (A s - b)^2, k what each
    reference presses with for every metre or radian that the mechanism does not let it go.

    Attributes:
        coordinate: of the mechanism [rad, m].
        strain: the greatest so far.
        strained: whether that is the limit on force.
        stopped: the mechanism at its stop.
        drive: how the law takes it along from rest; None where that is not predicted.
    """

    def __init__(self, stage: StagePlan, p: Vector, R: Vector, coordinate: float) -> None:
        context = stage.context
        self.p, self.R, self.left = p, R, ""
        self.coordinate = coordinate
        self.strain: Strain | None = None
        self.strained = False
        self.stopped: Stopped | None = None
        self._stage = stage
        self._model = context.mechanisms[context.held]
        self._declared = context.loaded.task.mechanisms[context.held]
        self._turns = stage.frame.mechanism is not None
        axis = self._model.rotation[:, 2]
        self.frame = stage.rotation
        if self._turns and coordinate:
            self.frame = pin.exp3(coordinate * axis) @ stage.rotation
        self._stiffness = {a: k for a in stage.axes if (k := _stiffness(stage, a)) > 0}
        self._missing = dict.fromkeys(self._stiffness, 0.0)
        self._low, self._high = self._declared.stop or (-math.inf, math.inf)
        self._beyond = 0.0
        self._points = [_Point(0.0, coordinate, dict.fromkeys(AXES, 0.0))]
        # Springs let it lag, and on a free knob the arm may turn instead of the mechanism.
        self.drive = None if coordinate else held_drive(stage)
        self._springs = stage.law.control_law.natural or not stage.law.control_law.force_loop

    def advance(self, time: float, moved: Mapping[Axis, float]) -> None:
        """Along what the mechanism leaves free."""
        before = self._points[-1].moved
        T = resolved_twists(self._stage, self.p, self.frame)
        rows = [a.row for a in self._stiffness]
        A, b = T[rows], np.array([moved[a] - before[a] for a in self._stiffness])
        k = np.sqrt(np.array(list(self._stiffness.values())))
        s = np.zeros(T.shape[1])
        if rows and b.any():
            s = np.linalg.lstsq(k[:, None] * A, k * b, rcond=1e-6)[0]
        missing = b - A @ s
        if self.drive is not None and self._springs:
            s = (self.drive.at(time) - self.drive.at(self._points[-1].time))[: len(s)]
        wanted = self.coordinate + float(s[0])
        inside = min(max(wanted, self._low), self._high)
        self._beyond += abs(wanted - inside)
        s[0] = inside - self.coordinate
        # By what it lags behind references that move, nothing is strained.
        missing = np.where((b == 0) | (inside != wanted), b - A @ s, missing)
        for a, each in zip(self._stiffness, missing, strict=True):
            self._missing[a] += float(each)
        self._carry(s)
        here = _Point(time, inside, dict(moved))
        drivers = [a for a, x in zip(self._stiffness, b, strict=True) if x]
        self._look(here, drivers[0] if len(drivers) == 1 else None)
        self._points = [self._points[-1], here]

    @property
    def borne(self) -> dict[Axis, float]:
        """The force of the robot on axes that the mechanism takes off their references [N, N m]."""
        return {a: k * self._missing[a] for a, k in self._stiffness.items()}

    def _carry(self, s: Vector) -> None:
        axis, model = self._model.rotation[:, 2], self._model
        self.coordinate += float(s[0])
        if not model.angular:
            self.p = self.p + s[0] * axis
        else:
            turn = pin.exp3(s[0] * axis)
            self.p = model.origin + turn @ (self.p - model.origin) + model.lead * s[0] * axis
            self.R = turn @ self.R
            if self._turns:
                self.frame = turn @ self.frame
        if model.free:
            self.R = pin.exp3(float(s[1]) * axis) @ self.R

    def _look(self, here: _Point, driver: Axis | None) -> None:
        """The load of the mechanism here, and whether it is at its stop."""
        last = self._points[-1]
        span = here.time - last.time
        if self._beyond:
            if self.stopped is None and driver is not None and len(self._points) > 1:
                rate = (last.coordinate - self._points[0].coordinate) / (
                    last.time - self._points[0].time
                )
                speed = (here.moved[driver] - last.moved[driver]) / span
                self.stopped = Stopped(here.time, here.coordinate, rate, 0.0, driver, speed)
            if self.stopped is not None:
                self.stopped = replace(self.stopped, beyond=self._beyond)
            return
        found = [self._pressed(here.time), self._driven(here, driver)]
        strain = max((s for s in found if s is not None), key=_weight, default=None)
        if strain is None or (self.strain is not None and _weight(strain) < _weight(self.strain)):
            return
        limits = self._stage.limits
        most = limits.torque if strain.axis.is_rotation else limits.force
        if most is not None and strain.force > most:
            same = self.strain is not None and self.strain.axis is strain.axis
            before = self.strain.force if self.strain is not None and same else 0.0
            share = (most - before) / max(strain.force - before, 1e-12)
            strain = replace(
                strain,
                force=most,
                mismatch=strain.mismatch * most / strain.force,
                time=last.time + max(share, 0.0) * span,
            )
            self.strained = True
        self.strain = strain

    def _pressed(self, time: float) -> Strain | None:
        """The axis that is pressed on most by what it misses."""
        found = (
            Strain(a, x, abs(self._stiffness[a] * x), time) for a, x in self._missing.items() if x
        )
        return max(found, key=_weight, default=None)

    def _driven(self, here: _Point, driver: Axis | None) -> Strain | None:
        """The force that drives the mechanism against its inertia, damping and friction.

        By virtual work f x' = (I s'' + d s' + friction) s': without a lever it is any force.
        """
        if driver is None or len(self._points) < 2:
            return None
        before, last = self._points
        span, span_before = here.time - last.time, last.time - before.time
        x = abs(here.moved[driver] - last.moved[driver]) / span
        # What the references begin and end with is not counted: the blending of a rate.
        if abs(x - abs(last.moved[driver] - before.moved[driver]) / span_before) > _STEADY * x:
            return None
        rate = (here.coordinate - last.coordinate) / span
        rate_before = (last.coordinate - before.coordinate) / span_before
        grows = 2 * (rate - rate_before) / (span + span_before)
        lever = rate * span / (here.moved[driver] - last.moved[driver])
        inertia = self._declared.coordinate_inertia
        effort = inertia * grows + self._declared.damping * rate
        effort += math.copysign(self._declared.friction, rate)
        return Strain(driver, 0.0, abs(effort * lever), here.time, drives=True)


def _weight(strain: Strain) -> float:
    """A force that weighs as much: a moment presses as a force at the grip's own lever does."""
    return strain.force / (GRIP.lever if strain.axis.is_rotation else 1.0)


def _stiffness(stage: StagePlan, axis: Axis) -> float:
    """The stiffness of a motion axis against the grip [N/m, N m/rad]; 0 where it yields."""
    plan = stage.plans[axis]
    # A force that displaces a spring leaves the spring where it is: it holds on.
    if not plan.motion or plan.force or isinstance(plan.mode, Follows):
        return 0.0
    law = stage.law.control_law
    own = stage.spring_of(axis)
    if law.selects:
        # It cancels what it measures there: the motion goes on whatever the grip bears.
        own = math.inf if plan.axis.stiffness is None else own
    k = GRIP.stiffness
    if axis.is_rotation:
        lever = np.cross(stage.rotation[:, axis.column], stage.kinematics.lever)
        k = GRIP.angular_stiffness + GRIP.stiffness * float(lever @ lever)
    return 1.0 / (1.0 / k + 1.0 / own) if own > 0 else 0.0
