"""Errors and rates of tracking in the coordinates of a stage's frame.

In frames that follow a surface or the force, or go with the tool, the reference is a point that its
rates move along, since no coordinate exists that the frame's turning would leave alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.geometry import rotation
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.reference.axis_reference import AxisReference
from taskspec.program.reference.coordinates import Coordinates


@dataclass(frozen=True, slots=True)
class Tracking:
    """Errors and feedforward on every existing axis.

    Attributes:
        error: e = x_d - x [m, rad]; zero on axes without a motion reference.
        velocity, acceleration: the reference twist of the control point, and the
            rate of its components, in frame axes [m/s, rad/s, ...].
        updates: memory after this tick.
    """

    error: dict[Axis, ca.SX]
    velocity: dict[Axis, ca.SX]
    acceleration: dict[Axis, ca.SX]
    updates: dict[str, ca.SX] = field(default_factory=dict)


def track(
    on: Coordinates, motions: Mapping[Axis, AxisReference], normals: Mapping[Axis, ca.SX]
) -> Tracking:
    """Errors and rates of the given references.

    Args:
        on: the coordinates.
        motions: references of the motion-controlled axes.
        normals: for open-loop forces outside a following frame, the coordinate that takes the
            place of the axis's own: the nominal gap along the axis.
    """
    tracking = Tracking({}, {}, {})
    spin = _rotations(on, motions, tracking)
    if on.frame.still:
        _fixed(on, motions, normals, tracking)
    elif on.frame.kind == "turning":
        _turning(on, motions, normals, tracking)
    else:
        _carried(on, motions, normals, tracking, spin)
    return tracking


def _rotations(on: Coordinates, motions: Mapping[Axis, AxisReference], out: Tracking) -> ca.SX:
    """Rotation errors; returns the reference angular velocity (3,) in frame axes."""
    names = [a for a in AXES[3:] if a in on.plans]
    if not names:
        return ca.SX.zeros(3)
    zero = ca.SX(0)
    angle = [motions[a].value if a in motions else zero for a in AXES[3:]]
    rate = [motions[a].rate if a in motions else zero for a in AXES[3:]]
    acceleration = [motions[a].acceleration if a in motions else zero for a in AXES[3:]]
    theta, theta_rate = ca.vertcat(*angle), ca.vertcat(*rate)
    turning = [m for m in motions if m.is_rotation]
    own = rotation_rate(theta, theta_rate, turning, motions)
    if own is theta_rate:
        own_acceleration = ca.vertcat(*acceleration)
    else:
        own_acceleration = on.clock.rate(own)
        if any(motions[m].mode.leaders for m in turning):
            state = ca.SX.sym("state", 6)
            of_state = rotation_rate(state[:3], state[3:], turning, motions)
            now = ca.vertcat(theta, theta_rate)
            bend = ca.vertcat(theta_rate, *acceleration)
            own_acceleration = ca.substitute(ca.jtimes(of_state, state, bend), state, now)
    # log(B Exp(theta) Q R^T) = B log(Exp(theta) (B^T R Q^T)^T): the rotation made so far serves
    # both as coordinate and in the error.
    follow = rotation.log(rotation.exp(theta) @ on.turned.T)
    if on.frame.kind == "tool":
        # The reference turns in the axes of the entry; the task's rows are those of now.
        turn = on.at.R.T @ on.base
        follow, own, own_acceleration = turn @ follow, turn @ own, turn @ own_acceleration
    hold = follow
    turns = on.frame.kind in ("following", "tracking", "turning")
    if turns and any(p.world for p in on.plans.values()):
        start = ca.reshape(on.marks["orientation"], 3, 3)
        base = ca.reshape(on.marks["base"], 3, 3)
        goal = base @ rotation.exp(theta) @ start
        hold = on.at.R.T @ rotation.log(goal @ on.terms.R.T)
    frame_rate = ca.SX.zeros(3)
    frame_acceleration = ca.SX.zeros(3)
    if on.frame.kind == "following":
        frame_rate = on.at.turning(_way(on, motions))
        frame_acceleration = on.clock.total_rate(frame_rate, on.terms)
    elif on.frame.kind == "tracking":
        # The measured force or the motion turns it: how that goes on is not known.
        frame_rate = on.at.turning(ca.SX.zeros(3))
    elif on.frame.kind == "turning":
        frame_rate, frame_acceleration = _handle_rate(on, motions)
    for name in names:
        i = AXES.index(name) - 3
        world = on.plans[name].world
        out.error[name] = (hold if world else follow)[i] if name in motions else zero
        out.velocity[name] = own[i] + (0 if world else frame_rate[i])
        out.acceleration[name] = own_acceleration[i] + (0 if world else frame_acceleration[i])
    return ca.vertcat(*(out.velocity.get(a, zero) for a in AXES[3:]))


def _fixed(
    on: Coordinates,
    motions: Mapping[Axis, AxisReference],
    normals: Mapping[Axis, ca.SX],
    out: Tracking,
) -> None:
    for name in _translations(on):
        motion = motions.get(name)
        here = normals.get(name, on.position[name])
        out.error[name] = motion.value - here if motion else ca.SX(0)
        out.velocity[name] = motion.rate if motion else ca.SX(0)
        out.acceleration[name] = motion.acceleration if motion else ca.SX(0)


def _turning(
    on: Coordinates,
    motions: Mapping[Axis, AxisReference],
    normals: Mapping[Axis, ca.SX],
    out: Tracking,
) -> None:
    """Tracking of the coordinates of a handle's circle and thread."""
    _fixed(on, motions, normals, out)
    rates = ca.vertcat(*(out.velocity.get(a, ca.SX(0)) for a in AXES[:3]))
    along = _velocity_map(on)
    wanted = along @ rates
    wanted_rate = on.clock.total_rate(wanted, on.terms) + along @ _coupled(on, motions)
    for name in _translations(on):
        i = AXES.index(name)
        out.velocity[name], out.acceleration[name] = wanted[i], wanted_rate[i]


def _velocity_map(on: Coordinates) -> ca.SX:
    mechanism, placed = on.frame.mechanism, ca.DM(on.frame.rotation)
    assert mechanism is not None
    return placed.T @ mechanism.velocity_map(on.terms.p) @ placed


def _handle_rate(on: Coordinates, motions: Mapping[Axis, AxisReference]) -> tuple[ca.SX, ca.SX]:
    """Angular velocity (3,) and acceleration (3,) that the references command for the frame.

    Where nothing commands the motion along the circle, the measured rate takes its place, and
    the acceleration is not known.
    """
    mechanism, placed = on.frame.mechanism, ca.DM(on.frame.rotation)
    assert mechanism is not None
    actual = on.at.rate_map @ (on.at.R.T @ on.terms.twist[:3])
    rates = ca.vertcat(
        *(motions[a].rate if a in motions else actual[i] for i, a in enumerate(AXES[:3]))
    )
    bends = ca.vertcat(*(motions[a].acceleration if a in motions else ca.SX(0) for a in AXES[:3]))
    axis, along = placed[2, :].T, placed[1, :] / mechanism.radius
    return axis * (along @ rates), axis * (along @ bends)


def _carried(
    on: Coordinates,
    motions: Mapping[Axis, AxisReference],
    normals: Mapping[Axis, ca.SX],
    out: Tracking,
    spin: ca.SX,
) -> None:
    """Tracking of a reference point that the reference's rates move along."""
    names = _translations(on)
    R, following = on.at.R, on.frame.kind == "following"
    here = on.point.p if on.at.foot is None else on.at.foot
    steps = ca.vertcat(*(_step(on, a, motions) for a in AXES[:3]))
    flat = on.frame.surface is not None and on.frame.surface.flat
    target = on.marks["reference_point"] + R @ steps
    if following:
        assert on.at.chart is not None
        target = target if flat else on.at.chart.foot(target)
    error = R.T @ (target - here)
    # A point on an axis without motion control goes with the tool. So it does on force axes of a
    # frame that tracks: what the surface falls away by is no error, and would turn into x.
    gone = [a for a in AXES[:3] if on.frame.tracking and a in on.plans and on.plans[a].force]
    kept = ca.diag(ca.vertcat(*(float(a in motions and a not in gone) for a in AXES[:3])))
    out.updates["reference_point"] = here + R @ (kept @ error) if names else target
    for a in AXES[:3]:
        out.updates[f"last.{a}"] = motions[a].value if a in motions else ca.SX(0)
    out.updates["place"] = here
    for a in AXES[:3]:
        out.updates[f"distance.{a}"] = on.position.get(a, ca.SX(0))
    wanted = _point_velocity(on, motions, spin)
    wanted_rate = on.clock.total_rate(wanted, on.terms) if following else on.clock.rate(wanted)
    wanted_rate += _over(on, _coupled(on, motions))
    for name in names:
        i, motion = AXES.index(name), motions.get(name)
        if following and name == "z":
            out.error[name] = motion.value - on.position[Axis.Z] if motion else ca.SX(0)
        else:
            out.error[name] = error[i] if motion else ca.SX(0)
        if name in normals and motion:
            out.error[name] = motion.value - normals[name]
        out.velocity[name], out.acceleration[name] = wanted[i], wanted_rate[i]


def _step(on: Coordinates, axis: Axis, motions: Mapping[Axis, AxisReference]) -> ca.SX:
    """The displacement of the reference of an axis since the last tick."""
    if axis not in motions or (axis == "z" and on.frame.kind == "following"):
        return ca.SX(0)
    return motions[axis].value - on.marks[f"last.{axis}"]


def _way(on: Coordinates, motions: Mapping[Axis, AxisReference]) -> ca.SX:
    """World velocity (3,) at which the tool point is to pass over the surface."""
    assert on.at.foot_map is not None
    actual = on.at.R.T @ on.tool.velocity
    foot = on.at.foot_map @ actual[:2]
    rates = ca.vertcat(
        *(motions[a].rate if a in motions else foot[i] for i, a in enumerate(AXES[:2]))
    )
    passing = _solve2(on.at.foot_map, rates)
    return on.at.R @ ca.vertcat(passing, 0)


def _point_velocity(on: Coordinates, motions: Mapping[Axis, AxisReference], spin: ca.SX) -> ca.SX:
    """Velocity (3,) of the control point that realises the reference's rates, frame axes."""
    rates = ca.vertcat(*(motions[a].rate if a in motions else 0 for a in AXES[:3]))
    over = _over(on, rates)
    return over if on.frame.kind == "tool" else over - ca.cross(spin, on.at.R.T @ on.tool.lever)


def _over(on: Coordinates, rates: ca.SX) -> ca.SX:
    """Velocity (3,) of the tool point at rates (3,) of the coordinates, frame axes."""
    if on.frame.kind == "tool":
        return rates
    assert on.at.foot_map is not None
    return ca.vertcat(_solve2(on.at.foot_map, rates[:2]), rates[2])


def _coupled(on: Coordinates, motions: Mapping[Axis, AxisReference]) -> ca.SX:
    """(3,) the part of couplings' accelerations that time alone does not decide.

    A leader that is integrated moves on by memory, of which a derivative by time knows nothing.
    """
    return ca.vertcat(
        *(
            motions[a].acceleration - on.clock.rate(motions[a].rate)
            if a in motions and motions[a].mode.leaders
            else ca.SX(0)
            for a in AXES[:3]
        )
    )


def _translations(on: Coordinates) -> list[Axis]:
    return [a for a in AXES[:3] if a in on.plans]


def _solve2(A: ca.SX, b: ca.SX) -> ca.SX:
    determinant = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0]
    return (
        ca.vertcat(A[1, 1] * b[0] - A[0, 1] * b[1], A[0, 0] * b[1] - A[1, 0] * b[0]) / determinant
    )


def rotation_rate(
    theta: ca.SX, theta_rate: ca.SX, names: list[Axis], motions: Mapping[Axis, AxisReference]
) -> ca.SX:
    """Angular velocity (3,) of the rotation vector theta(t).

    It equals theta' as long as at most one axis is commanded to turn: the decay of the others at
    entry keeps its direction.
    """
    if sum(motions[name].mode.moves for name in names) < 2:
        return theta_rate
    square = ca.dot(theta, theta) + 1e-24
    angle = ca.sqrt(square)
    across = ca.cross(theta, theta_rate)
    return (
        theta_rate
        + (1 - ca.cos(angle)) / square * across
        + (angle - ca.sin(angle)) / (square * angle) * ca.cross(theta, across)
    )
