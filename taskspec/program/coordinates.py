"""Where the tool is in its frame's coordinates, and the errors and rates of tracking there.

Four kinds of frames count translations differently (docs/language.md):

* fixed: the coordinate of the control point;
* turning with a handle: off its circle, along it from the stage's start, and along the axis;
* following a surface: x and y in lengths on the surface from the stage's start, z the gap;
* carried by the tool: the way along the tool's own axes from the stage's start.

In the last two the reference is a point that is moved along by the rates of the reference, since no
coordinate exists that the frame's turning would leave alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import casadi as ca

from taskspec.control.model_terms import TermSymbols
from taskspec.control.state import AXES
from taskspec.geometry import rotation
from taskspec.program import kinematics
from taskspec.program.axis_reference import AxisReference
from taskspec.program.believed import Believed
from taskspec.program.clock import Clock
from taskspec.program.frames import FrameModel
from taskspec.program.layout import Layout
from taskspec.program.modes import AxisPlan


@dataclass(frozen=True, slots=True)
class Tracking:
    """Errors and feedforward on every existing axis.

    Attributes:
        error: e = x_d - x [m, rad]; zero on axes without a motion reference.
        velocity, acceleration: the twist that the reference asks of the control point, and the
            rate of its components, in frame axes [m/s, rad/s, ...].
        updates: memory after this tick.
    """

    error: dict[str, ca.SX]
    velocity: dict[str, ca.SX]
    acceleration: dict[str, ca.SX]
    updates: dict[str, ca.SX] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Coordinates:
    """The measured coordinates of a stage's frame.

    Attributes:
        position: of every existing axis [m, rad].
        base: (3, 3) axes to which rotations are relative: the frame, or the tool's at entry.
        turned: (3, 3) rotation in those axes since the stage's start.
    """

    position: dict[str, ca.SX]
    base: ca.SX
    turned: ca.SX
    frame: FrameModel
    at: kinematics.FrameState
    tool: kinematics.ToolPoint
    point: kinematics.ControlPoint
    terms: TermSymbols
    clock: Clock
    plans: Mapping[str, AxisPlan]
    marks: Mapping[str, ca.SX]

    def track(self, motions: Mapping[str, AxisReference], normals: Mapping[str, ca.SX]) -> Tracking:
        """Errors and rates of the given references.

        Args:
            motions: references of the motion-controlled axes.
            normals: for open-loop forces outside a following frame, the coordinate that takes the
                place of the axis's own: the believed gap along the axis.
        """
        tracking = Tracking({}, {}, {})
        spin = self._rotations(motions, tracking)
        if self.frame.still:
            self._fixed(motions, normals, tracking)
        elif self.frame.kind == "turning":
            self._turning(motions, normals, tracking)
        else:
            self._carried(motions, normals, tracking, spin)
        return tracking

    def _rotations(self, motions: Mapping[str, AxisReference], out: Tracking) -> ca.SX:
        """Rotation errors; returns the reference angular velocity (3,) in frame axes."""
        names = [a for a in AXES[3:] if a in self.plans]
        if not names:
            return ca.SX.zeros(3)
        zero = ca.SX(0)
        angle = [motions[a].value if a in motions else zero for a in AXES[3:]]
        rate = [motions[a].rate if a in motions else zero for a in AXES[3:]]
        acceleration = [motions[a].acceleration if a in motions else zero for a in AXES[3:]]
        theta, theta_rate = ca.vertcat(*angle), ca.vertcat(*rate)
        own = rotation_rate(theta, theta_rate, [m for m in motions if m.startswith("r")], motions)
        own_acceleration = ca.vertcat(*acceleration) if own is theta_rate else self.clock.rate(own)
        # log(B Exp(theta) Q R^T) = B log(Exp(theta) (B^T R Q^T)^T): the rotation made so far serves
        # both as coordinate and in the error.
        follow = rotation.log(rotation.exp(theta) @ self.turned.T)
        if self.frame.kind == "tool":
            # The reference turns in the axes of the entry; the task's rows are those of now.
            turn = self.at.R.T @ self.base
            follow, own, own_acceleration = turn @ follow, turn @ own, turn @ own_acceleration
        hold = follow
        turns = self.frame.kind in ("following", "turning")
        if turns and any(p.world for p in self.plans.values()):
            start = ca.reshape(self.marks["orientation"], 3, 3)
            base = ca.reshape(self.marks["base"], 3, 3)
            goal = base @ rotation.exp(theta) @ start
            hold = self.at.R.T @ rotation.log(goal @ self.terms.R.T)
        frame_rate = ca.SX.zeros(3)
        frame_acceleration = ca.SX.zeros(3)
        if self.frame.kind == "following":
            frame_rate = self.at.turning(self._way(motions))
            frame_acceleration = self.clock.total_rate(frame_rate, self.terms)
        elif self.frame.kind == "turning":
            frame_rate, frame_acceleration = self._handle_rate(motions)
        for name in names:
            i = AXES.index(name) - 3
            world = self.plans[name].world
            out.error[name] = (hold if world else follow)[i] if name in motions else zero
            out.velocity[name] = own[i] + (0 if world else frame_rate[i])
            out.acceleration[name] = own_acceleration[i] + (0 if world else frame_acceleration[i])
        return ca.vertcat(*(out.velocity.get(a, zero) for a in AXES[3:]))

    def _fixed(
        self,
        motions: Mapping[str, AxisReference],
        normals: Mapping[str, ca.SX],
        out: Tracking,
    ) -> None:
        for name in self._translations():
            motion = motions.get(name)
            here = normals.get(name, self.position[name])
            out.error[name] = motion.value - here if motion else ca.SX(0)
            out.velocity[name] = motion.rate if motion else ca.SX(0)
            out.acceleration[name] = motion.acceleration if motion else ca.SX(0)

    def _turning(
        self,
        motions: Mapping[str, AxisReference],
        normals: Mapping[str, ca.SX],
        out: Tracking,
    ) -> None:
        """Tracking of the coordinates of a handle's circle and thread."""
        self._fixed(motions, normals, out)
        rates = ca.vertcat(*(out.velocity.get(a, ca.SX(0)) for a in AXES[:3]))
        wanted = self._velocity_map() @ rates
        wanted_rate = self.clock.total_rate(wanted, self.terms)
        for name in self._translations():
            i = AXES.index(name)
            out.velocity[name], out.acceleration[name] = wanted[i], wanted_rate[i]

    def _velocity_map(self) -> ca.SX:
        mechanism, placed = self.frame.mechanism, ca.DM(self.frame.rotation)
        assert mechanism is not None
        return placed.T @ mechanism.velocity_map(self.terms.p) @ placed

    def _handle_rate(self, motions: Mapping[str, AxisReference]) -> tuple[ca.SX, ca.SX]:
        """Angular velocity (3,) and acceleration (3,) that the references ask of the frame.

        Where nothing commands the way along the circle, the measured rate takes its place, and
        the acceleration is not known.
        """
        mechanism, placed = self.frame.mechanism, ca.DM(self.frame.rotation)
        assert mechanism is not None
        actual = self.at.rate_map @ (self.at.R.T @ self.terms.twist[:3])
        rates = ca.vertcat(
            *(motions[a].rate if a in motions else actual[i] for i, a in enumerate(AXES[:3]))
        )
        bends = ca.vertcat(
            *(motions[a].acceleration if a in motions else ca.SX(0) for a in AXES[:3])
        )
        axis, along = placed[2, :].T, placed[1, :] / mechanism.radius
        return axis * (along @ rates), axis * (along @ bends)

    def _carried(
        self,
        motions: Mapping[str, AxisReference],
        normals: Mapping[str, ca.SX],
        out: Tracking,
        spin: ca.SX,
    ) -> None:
        """Tracking of a reference point that the reference's rates move along."""
        names = self._translations()
        R, following = self.at.R, self.frame.kind == "following"
        here = self.at.foot if following else self.point.p
        steps = ca.vertcat(*(self._step(a, motions) for a in AXES[:3]))
        flat = following and self.at.chart is not None and self.at.chart.flat
        target = self.marks["reference_point"] + R @ steps
        if following:
            assert self.at.chart is not None
            target = target if flat else self.at.chart.foot(target)
        error = R.T @ (target - here)
        # A point on an axis without motion control goes with the tool.
        kept = ca.diag(ca.vertcat(*(float(a in motions) for a in AXES[:3])))
        out.updates["reference_point"] = here + R @ (kept @ error) if names else target
        for a in AXES[:3]:
            out.updates[f"last.{a}"] = motions[a].value if a in motions else ca.SX(0)
        out.updates["place"] = here
        for a in AXES[:3]:
            out.updates[f"way.{a}"] = self.position.get(a, ca.SX(0))
        wanted = self._point_velocity(motions, spin)
        wanted_rate = (
            self.clock.total_rate(wanted, self.terms) if following else self.clock.rate(wanted)
        )
        for name in names:
            i, motion = AXES.index(name), motions.get(name)
            if following and name == "z":
                out.error[name] = motion.value - self.position["z"] if motion else ca.SX(0)
            else:
                out.error[name] = error[i] if motion else ca.SX(0)
            if name in normals and motion:
                out.error[name] = motion.value - normals[name]
            out.velocity[name], out.acceleration[name] = wanted[i], wanted_rate[i]

    def _step(self, axis: str, motions: Mapping[str, AxisReference]) -> ca.SX:
        """How far the reference of an axis has moved since the last tick."""
        if axis not in motions or (axis == "z" and self.frame.kind == "following"):
            return ca.SX(0)
        return motions[axis].value - self.marks[f"last.{axis}"]

    def _way(self, motions: Mapping[str, AxisReference]) -> ca.SX:
        """World velocity (3,) at which the tool point is to pass over the surface."""
        assert self.at.foot_map is not None
        actual = self.at.R.T @ self.tool.velocity
        foot = self.at.foot_map @ actual[:2]
        rates = ca.vertcat(
            *(motions[a].rate if a in motions else foot[i] for i, a in enumerate("xy"))
        )
        passing = _solve2(self.at.foot_map, rates)
        return self.at.R @ ca.vertcat(passing, 0)

    def _point_velocity(self, motions: Mapping[str, AxisReference], spin: ca.SX) -> ca.SX:
        """Velocity (3,) of the control point that realises the reference's rates, frame axes."""
        rates = ca.vertcat(*(motions[a].rate if a in motions else 0 for a in AXES[:3]))
        if self.frame.kind == "tool":
            return rates
        assert self.at.foot_map is not None
        over = ca.vertcat(_solve2(self.at.foot_map, rates[:2]), rates[2])
        return over - ca.cross(spin, self.at.R.T @ self.tool.lever)

    def _translations(self) -> list[str]:
        return [a for a in AXES[:3] if a in self.plans]


def _solve2(A: ca.SX, b: ca.SX) -> ca.SX:
    determinant = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    return (
        ca.vertcat(A[1, 1] * b[0] - A[0, 1] * b[1], A[0, 0] * b[1] - A[1, 0] * b[0]) / determinant
    )


def rotation_rate(
    theta: ca.SX,
    theta_rate: ca.SX,
    names: list[str],
    motions: Mapping[str, AxisReference],
) -> ca.SX:
    """Angular velocity (3,) of the rotation vector theta(t).

    It equals theta' as long as at most one axis is told to turn: the decay of the others at entry
    keeps its direction.
    """
    if sum(motions[name].mode != "hold" for name in names) < 2:
        return theta_rate
    square = ca.dot(theta, theta) + 1e-24
    angle = ca.sqrt(square)
    across = ca.cross(theta, theta_rate)
    return (
        theta_rate
        + (1 - ca.cos(angle)) / square * across
        + (angle - ca.sin(angle)) / (square * angle) * ca.cross(theta, across)
    )


def frame_coordinates(
    *,
    frame: FrameModel,
    at: kinematics.FrameState,
    tool: kinematics.ToolPoint,
    point: kinematics.ControlPoint,
    terms: TermSymbols,
    gap: ca.SX | None,
    clock: Clock,
    memory: Layout,
    parameters: Layout,
    plans: Mapping[str, AxisPlan],
    believed: Believed | None,
) -> Coordinates:
    """Measured coordinates; takes the memory and parameters that the frame's kind needs."""
    marks: dict[str, ca.SX] = {}
    position: dict[str, ca.SX] = {}
    if frame.still:
        local = at.R.T @ (point.p - at.origin)
        position = {a: local[i] for i, a in enumerate(AXES[:3]) if a in plans}
    elif frame.kind == "turning":
        assert frame.mechanism is not None
        assert believed is not None
        away = frame.mechanism.deviation(terms.p, believed.angle, believed.since)
        local = ca.DM(frame.rotation.T) @ (away - ca.DM(frame.origin))
        position = {a: local[i] for i, a in enumerate(AXES[:3]) if a in plans}
    else:
        for name, length in (("reference_point", 3), ("place", 3)):
            marks[name] = memory.add(name, length)
        for a in AXES[:3]:
            marks[f"last.{a}"] = memory.add(f"last.{a}")
            marks[f"way.{a}"] = memory.add(f"way.{a}")
        here = at.foot if frame.kind == "following" else point.p
        moved = at.R.T @ (here - marks["place"])
        position = {a: marks[f"way.{a}"] + moved[i] for i, a in enumerate(AXES[:3]) if a in plans}
        if frame.kind == "following" and "z" in plans:
            assert gap is not None
            position["z"] = gap
    base, turned = at.R, ca.SX.eye(3)
    if any(a.startswith("r") for a in plans):
        marks["orientation"] = parameters.add("orientation", 9)
        if not frame.still:
            marks["base"] = parameters.add("base", 9)
        if frame.kind == "tool":
            base = ca.reshape(marks["base"], 3, 3)
        start = ca.reshape(marks["orientation"], 3, 3)
        turned = base.T @ terms.R @ start.T
        angles = rotation.log(turned)
        position |= {a: angles[i] for i, a in enumerate(AXES[3:]) if a in plans}
    return Coordinates(
        position=position,
        base=base,
        turned=turned,
        frame=frame,
        at=at,
        tool=tool,
        point=point,
        terms=terms,
        clock=clock,
        plans=plans,
        marks=marks,
    )
