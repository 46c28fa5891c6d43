"""The tool in its task frame: control point, frame axes, coordinates and how they change."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

import casadi as ca
import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.geometry import rotation
from taskspec.program.slots import Slots
from taskspec.program.world import estimated_frames, tracked_frames
from taskspec.program.world.frames import FrameModel
from taskspec.program.world.mechanisms import MechanismModel
from taskspec.robot import RobotModel
from taskspec.robot.model_terms import TermSymbols
from taskspec.shapes import BoundedSurface, Plane, Sphere, Surface, SurfaceChart
from taskspec.shapes.overlap import CYLINDER
from taskspec.shapes.round_patch import RoundPatch
from taskspec.shapes.solid import half_sizes, rounding, touched_whole


@dataclass(frozen=True, slots=True)
class ControlPoint:
    """The body-fixed point of the tool to which motion, force and moment refer; world axes.

    Attributes:
        offset: (3,) from the tip [m].
        p: (3,) position.
        J: (6, n).
        drift: (6,) J' q'.
        twist: (6,) J q'.
        wrench: (6,) measured, by the environment, moment about this point.
    """

    offset: ca.SX
    p: ca.SX
    J: ca.SX
    drift: ca.SX
    twist: ca.SX
    wrench: ca.SX


def control_point(terms: TermSymbols, wrench: ca.SX, offset: ca.SX | None) -> ControlPoint:
    """Shifts the tip's kinematics and the measured wrench to the control point.

    Args:
        terms: kinematics of the tip.
        wrench: (6,) about the tip.
        offset: (3,) control point in tip axes, None for the tip itself.
    """
    if offset is None:
        zero = ca.SX.zeros(3)
        return ControlPoint(zero, terms.p, terms.J, terms.drift, terms.twist, wrench)
    rho = terms.R @ offset
    w, alpha = terms.twist[3:], terms.drift[3:]
    return ControlPoint(
        offset=rho,
        p=terms.p + rho,
        J=ca.vertcat(terms.J[:3, :] - ca.skew(rho) @ terms.J[3:, :], terms.J[3:, :]),
        drift=ca.vertcat(
            terms.drift[:3] + ca.cross(alpha, rho) + ca.cross(w, ca.cross(w, rho)), alpha
        ),
        twist=ca.vertcat(terms.twist[:3] + ca.cross(w, rho), w),
        wrench=ca.vertcat(wrench[:3], wrench[3:] - ca.cross(rho, wrench[:3])),
    )


@dataclass(frozen=True, slots=True)
class ToolPoint:
    """The point of the tool that a following frame is nearest to: a ball's centre, or the tip.

    Attributes:
        center: (3,) world [m].
        lever: (3,) from the tip.
        velocity: (3,) world [m/s].
        radius: [m] between this point and the tool's surface.
    """

    center: ca.SX
    lever: ca.SX
    velocity: ca.SX
    radius: float


def tool_point(robot: RobotModel, terms: TermSymbols) -> ToolPoint:
    """The reference point of the robot's tool."""
    tool = robot.tool
    local = np.zeros(3) if tool.flat else tool.centers[0]
    lever = terms.R @ ca.DM(local)
    return ToolPoint(
        center=terms.p + lever,
        lever=lever,
        velocity=terms.twist[:3] + ca.cross(terms.twist[3:], lever),
        radius=0.0 if tool.flat else float(tool.radii[0]),
    )


def gap(robot: RobotModel, surface: Surface, p: ca.SX, R: ca.SX) -> ca.SX:
    """Signed distance [m] between the tool's shape at pose (p, R) and a surface.

    Of a flat tool from a plane or a ball it is exact; from boxes and cylinders it is that of the
    corners, and of points of the rims, of both; from a plate with a cut that of its face; from a
    panel that of the centre or axis less the radius, beyond its edges that of the tool's points.
    """
    tool = robot.tool
    middle = p + R @ ca.DM([0.0, 0.0, tool.middle])
    if tool.flat and isinstance(surface, Plane):
        down = -(R.T @ surface.gradient(p))
        return surface.distance(middle) - _reach(tool.solid, down)
    if tool.flat and isinstance(surface, Sphere):
        away = R.T @ (ca.DM(surface.origin) - middle)
        return tool.solid.height(away) - surface.radius
    if tool.flat and isinstance(surface, BoundedSurface) and touched_whole(surface):
        points, own = tool.solid.extremes()[0], surface.extremes()[0]
        gaps = [surface.distance(middle + R @ ca.DM(point)) for point in points]
        for point in own:
            place = surface.origin + surface.rotation @ point
            gaps.append(tool.solid.height(R.T @ (ca.DM(place) - middle)))
    else:
        gaps = [
            surface.distance(p + R @ ca.DM(center)) - float(radius)
            for center, radius in zip(tool.centers, tool.radii, strict=True)
        ]
    if tool.flat and isinstance(surface, RoundPatch) and not surface.within:
        core = R.T @ (surface.core(middle) - middle)
        whole = tool.solid.height(core) - surface.radius
        gaps.append(ca.if_else(surface.chart().margin(middle, None) > 0, whole, gaps[0]))
    nearest = gaps[0]
    for other in gaps[1:]:
        nearest = ca.fmin(nearest, other)
    return nearest


def _reach(solid: BoundedSurface, u: ca.SX) -> ca.SX:
    """The support function of a cylinder or a box about its centre, along u (3,) of its axes.

    Edges are rounded as the plant has them (`overlap`).
    """
    sizes = half_sizes(solid)
    assert sizes is not None
    kind, half = sizes
    eps = rounding(half)
    parts = [(half[i], u[i] ** 2) for i in range(3)]
    if kind == CYLINDER:
        parts = [(half[0], u[0] ** 2 + u[1] ** 2), parts[2]]
    reach = sum((h * ca.sqrt(square + (eps / h) ** 2) for h, square in parts), ca.SX(0))
    return reach - (len(parts) - 1) * eps


@dataclass(frozen=True, slots=True)
class FrameState:
    """A frame at this instant.

    Attributes:
        R: (3, 3) axes in the world; R_rate: (3, 3) its time derivative.
        origin: (3,) in the world, of a frame that stays where it is.
        chart: of a following frame.
        foot: (3,) of a following frame: the surface point nearest to the tool; of a tracking frame
            the tool point itself.
        foot_map: (2, 2) velocity of the foot per velocity of the tool point, along x and y.
        rate_map: (3, 3) rates of the coordinates per velocity of the tool point, frame axes.
        margin: positive while the frame is defined.
        turning: angular velocity (3,) of the frame in its own axes when the tool point moves at a
            world velocity (3,); zero for frames that do not turn with the tool's place.
    """

    R: ca.SX
    R_rate: ca.SX
    margin: ca.SX
    origin: ca.SX | None = None
    chart: SurfaceChart | None = None
    foot: ca.SX | None = None
    foot_map: ca.SX | None = None
    turning: Callable[[ca.SX], ca.SX] = lambda _velocity: ca.SX.zeros(3)
    rate_map: ca.SX = field(default_factory=lambda: ca.SX.eye(3))


def frame_state(
    frame: FrameModel, terms: TermSymbols, tool: ToolPoint, face: ca.SX | None
) -> FrameState:
    """Evaluates a frame.

    `face` holds the numbers of the part that it follows, the 12 of a measured pose, or the 9 of
    `tracked_frames`.
    """
    always = ca.SX(1)
    if frame.kind == "fixed":
        R, origin = (ca.SX(ca.DM(part)) for part in (frame.rotation, frame.origin))
        return FrameState(R, ca.SX.zeros(3, 3), always, origin)
    if frame.kind == "estimated":
        assert face is not None
        R, origin = estimated_frames.placed(frame, face)
        return FrameState(R, ca.SX.zeros(3, 3), always, origin)
    if frame.kind == "tool":
        R = terms.R @ ca.DM(frame.rotation)
        return FrameState(R, ca.skew(terms.twist[3:]) @ R, always)
    if frame.kind == "tracking":
        assert face is not None
        return _tracking_state(frame, tool, face)
    if frame.mechanism is not None:
        return _handle_state(frame, frame.mechanism, terms)
    assert frame.surface is not None
    chart = frame.surface.chart(face)
    margin = chart.margin(tool.center, frame.heading)
    if frame.surface.flat:
        R = chart.frame(tool.center, frame.heading)
        return FrameState(
            R=R,
            R_rate=ca.SX.zeros(3, 3),
            margin=margin,
            chart=chart,
            foot=chart.foot(tool.center),
            foot_map=ca.SX.eye(2),
        )
    c, direction = ca.SX.sym("c", 3), ca.SX.sym("dc", 3)
    # What a chart of many facets is here does not change with the point that it is evaluated at.
    numbers = chart.numbers(tool.center)
    given = [] if numbers is None else [numbers]
    part = [ca.SX.sym("part", each.shape[0]) for each in given]
    around = chart.near(*part) if part else chart
    R_c, foot_c = around.frame(c, frame.heading), around.foot(c)
    rate_c = ca.reshape(ca.jtimes(ca.vec(R_c), c, direction), 3, 3)
    turning_c = rotation.unskew(R_c.T @ rate_c)
    at = ca.Function("at", [c, *part], [R_c, foot_c, ca.jacobian(foot_c, c)])
    moving = ca.Function("moving", [c, direction, *part], [rate_c, turning_c])
    R, foot, slope = at(tool.center, *given)
    foot_map = R[:, :2].T @ slope @ R[:, :2]
    return FrameState(
        R=R,
        R_rate=moving(tool.center, tool.velocity, *given)[0],
        margin=margin,
        chart=chart,
        foot=foot,
        foot_map=foot_map,
        rate_map=ca.diagcat(foot_map, 1),
        turning=lambda velocity: moving(tool.center, velocity, *given)[1],
    )


def _tracking_state(frame: FrameModel, tool: ToolPoint, state: ca.SX) -> FrameState:
    """A frame that turns as the last tick had it turn, whatever the tool does."""
    normal = ca.SX.sym("normal", 3)
    axes, defined = tracked_frames.axes(frame, normal)
    at = ca.Function("at", [normal], [axes, defined])
    rate = ca.SX.sym("rate", 3)
    turned = ca.reshape(ca.jtimes(ca.vec(axes), normal, rate), 3, 3)
    moving = ca.Function("moving", [normal, rate], [turned])
    R, margin = at(state[3:6])
    R_rate = moving(state[3:6], state[6:])
    spin = rotation.unskew(R.T @ R_rate)
    return FrameState(
        R=R,
        R_rate=R_rate,
        margin=margin,
        foot=tool.center,
        foot_map=ca.SX.eye(2),
        turning=lambda _velocity: spin,
    )


def _handle_state(frame: FrameModel, mechanism: MechanismModel, terms: TermSymbols) -> FrameState:
    """A frame that turns with a handle: its axes follow from where the tip is about the axis."""
    p, placed = terms.p, ca.DM(frame.rotation)
    axis = ca.DM(mechanism.rotation[:, 2])
    R = mechanism.handle_axes(p) @ placed
    spin = mechanism.turning(p, terms.twist[:3]) * axis
    along = placed[2, :].T
    return FrameState(
        R=R,
        R_rate=ca.skew(spin) @ R,
        margin=mechanism.margin(p),
        rate_map=placed.T @ mechanism.rate_map(p) @ placed,
        turning=lambda velocity: along * mechanism.turning(p, velocity),
    )


def new_face(layout: Slots, frame: FrameModel, prefix: str) -> ca.SX | None:
    """The parameters of a frame: of the part that it follows, of its estimate, or None."""
    if frame.kind == "estimated":
        return estimated_frames.symbols(layout, frame)
    if frame.kind != "following" or frame.surface is None or not frame.surface.face_size:
        return None
    return layout.add(f"{prefix}.face", frame.surface.face_size)
