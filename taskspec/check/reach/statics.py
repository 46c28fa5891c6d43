"""Forces of a stage at rest, as rows: set points, limits, torques and what contacts return.

x = (f_1, ..., f_k, m), the force (3,) [N] that the robot applies to each object, in the
world's axes, and the moment (3,) about the tip, in units of the tool's size times a newton. At rest

    u = g(q) + J^T (sum f_i, m),

a contact returns f_i when -n.f_i >= 0 and |f_i + (n.f_i) n| <= friction (-n.f_i).

A ball touches in one point, so f_i has a known moment and m = 0; a flat tool bears moments up to
its size times the force.

Cones and balls are replaced by polytopes around them that touch them where the set points lie, so
that what contradicts itself here does so in truth.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.check.reach.rows import Asked, Line, System, kept, limit_place, shares_of
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.context import Context
from taskspec.program.known import known_value
from taskspec.program.trajectory import Place
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.robot.mobility import tip_jacobian
from taskspec.spec import FILE, key_of
from taskspec.text.show import show

Vector = NDArray[np.float64]

TORQUE = "torque limit"
OTHERWISE = "work in another posture"
_FACES = 8
#: Directions in which a magnitude is bounded: faces, edges and corners of a cube.
_AROUND = np.array(
    [
        v / np.linalg.norm(v)
        for v in np.array(np.meshgrid(*[[-1, 0, 1]] * 3)).reshape(3, -1).T.astype(float)
        if v.any()
    ]
)


def statics(context: Context, asked: Asked, place: Place) -> tuple[System, Vector]:
    """The rows of a stage's forces at a place, and the forces that its set points are alone.

    Args:
        context: the task. asked: what the stage asks for. place: where.
    """
    objects = [""] if asked.normals is None else list(asked.normals)
    reach = _reach(context)
    system = System(3 * len(objects) + 3)
    whole = np.zeros((6, system.size))
    ball = _touching(context, asked, place)
    for i, name in enumerate(objects):
        own = slice(3 * i, 3 * i + 3)
        whole[:3, own] = np.eye(3)
        if name in ball:
            whole[3:, own] = pin.skew(ball[name])
    whole[3:, -3:] = reach * np.eye(3)
    stage = context.loaded.task.stages[asked.name]
    about = whole.copy()
    lever = context.lever_of(context.frame_of(stage))
    about[3:] -= pin.skew(lever) @ whole[:3]
    wanted = _wanted(asked, place.rotation)
    _add_set_points(context, asked, place.rotation, about, system)
    _add_limits(context, asked, about, wanted, system)
    if asked.normals is not None:
        _add_contacts(context, asked, wanted[:3], not ball, system)
    if place.q is not None:
        _add_torques(context, place.q, whole, shares_of(context, asked.name).torque, system)
    guess = np.zeros(system.size)
    nearest = context.contact_of(context.frame_of(stage))
    at = 3 * objects.index(nearest) if nearest in objects else 0
    guess[at : at + 3] = wanted[:3]
    if not ball:
        guess[-3:] = (wanted[3:] + np.cross(lever, wanted[:3])) / reach
    return system, guess


def _wanted(asked: Asked, rotation: Vector) -> Vector:
    """(6,) the set points alone, in the world's axes."""
    values = np.array([asked.forces.get(a, 0.0) for a in AXES])
    return np.concatenate([rotation @ values[:3], rotation @ values[3:]])


def _add_set_points(
    context: Context, asked: Asked, rotation: Vector, about: Vector, system: System
) -> None:
    inside = np.kron(np.eye(2), rotation.T) @ about
    for axis, value in asked.forces.items():
        key, unit = ("torque", "N*m") if axis.is_rotation else ("force", "N")
        span = context.loaded.span(FILE.stages[asked.name].axes[axis][key])
        words = f"{show(value, unit)} {'about' if key == 'torque' else 'along'} {axis!r}"
        line = Line("set point", words, span, f"lower the {key}", value, unit)
        system.add(inside[AXES.index(axis)], value, value, line)


def _add_limits(
    context: Context, asked: Asked, about: Vector, wanted: Vector, system: System
) -> None:
    limits = context.limits_of(context.loaded.task.stages[asked.name])
    share = shares_of(context, asked.name).force
    parts = (("force", limits.force if asked.limited else None, 0, "N", share),
             ("torque", limits.torque, 3, "N*m", 1.0))  # fmt: skip
    for key, bound, first, unit, part in parts:
        if bound is None:
            continue
        most = part * bound
        words = f"limits.{key}, {show(bound, unit)}{kept(part)}"
        line = Line("limit", words, limit_place(context, asked.name, key), "raise the limit")
        for direction in _directions(wanted[first : first + 3]):
            system.add(direction @ about[first : first + 3], -np.inf, most, line)


def _add_contacts(
    context: Context, asked: Asked, wanted: Vector, moments_too: bool, system: System
) -> None:
    assert asked.normals is not None
    share = shares_of(context, asked.name).friction
    moments = np.zeros((3, system.size))
    moments[:, -3:] = np.eye(3)
    lean = np.zeros(system.size)
    for i, (name, normal) in enumerate(asked.normals.items()):
        own = slice(3 * i, 3 * i + 3)
        whole = context.loaded.task.shapes[name].friction
        friction = share * whole
        push = np.zeros(system.size)
        push[own] = -normal
        span = context.loaded.span(key_of(FILE.world[name]))
        words = f"{name!r}, which can only push back"
        line = Line("contact", words, span, "press against the outward normal")
        system.add(push, 0.0, np.inf, line)
        given = "friction" in context.loaded.task.shapes[name].model_fields_set
        place = FILE.world[name].friction
        span = context.loaded.span(place if given else key_of(place))
        words = f"the friction of {name!r}, {whole:g}{kept(share) if whole else ''}"
        line = Line("contact", words, span, "press harder")
        for tangent in _tangents(normal, wanted):
            row = np.zeros(system.size)
            row[own] = tangent
            system.add(row - friction * push, -np.inf, 0.0, line)
        lean += moments_too * np.hypot(1.0, friction) * push
    words, mend = "the size of the tool's face", "press harder"
    if not moments_too:
        words, mend = "a ball, which touches in one point and bears no moment", "take a flat tool"
    line = Line("face", words, None, mend)
    for row in (*moments, *-moments):
        system.add(row - lean, -np.inf, 0.0, line)


def _add_torques(context: Context, q: Vector, whole: Vector, share: float, system: System) -> None:
    robot = context.robot
    gravity = pin.computeGeneralizedGravity(robot.pin, robot.pin.createData(), q)
    J = tip_jacobian(robot.pin, robot.tip_joint, robot.tip, q)
    for i, most in enumerate(robot.torque_limit):
        if not np.isfinite(most):
            continue
        unit = "N*m" if turns_at(robot, i) else "N"
        words = f"joint {i + 1} ({show(float(most), unit)}{kept(share)})"
        line = Line(TORQUE, words, None, OTHERWISE)
        # Gravity alone is always allowed.
        low, high = min(-share * most - gravity[i], 0.0), max(share * most - gravity[i], 0.0)
        if share == 1.0:
            low, high = -most - gravity[i], most - gravity[i]
        system.add(J[:, i] @ whole, low, high, line)


def _directions(wanted: Vector) -> Iterable[Vector]:
    size = float(np.linalg.norm(wanted))
    return _AROUND if size == 0 else (*_AROUND, wanted / size)


def _tangents(normal: Vector, wanted: Vector) -> Iterable[Vector]:
    """Unit vectors (3,) across a normal, the first along what is wanted across it."""
    first = wanted - (normal @ wanted) * normal
    if np.linalg.norm(first) < 1e-9 * max(1.0, float(np.linalg.norm(wanted))):
        first = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first = first / np.linalg.norm(first)
    second = np.cross(normal, first)
    for k in range(_FACES):
        angle = 2 * np.pi * k / _FACES
        yield np.cos(angle) * first + np.sin(angle) * second


def _touching(context: Context, asked: Asked, place: Place) -> dict[str, Vector]:
    """From the tip to where a ball touches each object (3,); empty for flat tools [m]."""
    robot = context.robot
    if robot.tool.flat or place.q is None or asked.normals is None:
        return {}
    data = robot.pin.createData()
    pin.forwardKinematics(robot.pin, data, place.q)
    R = (data.oMi[robot.tip_joint] * robot.tip).rotation
    center, radius = R @ robot.tool.centers[0], robot.tool.radii[0]
    return {name: center - radius * normal for name, normal in asked.normals.items()}


def _reach(context: Context) -> float:
    """The farthest that the tool touches from its tip [m]."""
    tool = context.robot.tool
    return float(np.max(np.linalg.norm(tool.centers, axis=1) + tool.radii))


def steady(context: Context, name: str, axes: tuple[Axis, ...]) -> dict[Axis, float]:
    """Set points of stage `name` that are constant and not zero [N, N m]."""
    found = {}
    for axis, entry in context.loaded.task.stages[name].axes.items():
        force = entry.set_point
        value = None if force is None else known_value(context, force.wanted)
        if value and axis in axes:
            found[axis] = value
    return found
