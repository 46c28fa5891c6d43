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

from collections.abc import Iterable, Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES
from taskspec.geometry.rotation import cross
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan
from taskspec.program.trajectory import Place
from taskspec.robot.inverse_kinematics import turns_at
from taskspec.spec import FILE, Limits, key_of
from taskspec.statics.rows import RowCause, RowSystem, kept, limit_place, shares_of
from taskspec.text.units import FORCE, show

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


def statics(stage: StagePlan, place: Place) -> tuple[RowSystem, Vector]:
    """The rows of a stage's forces at a place, and the forces that its set points are alone."""
    normals = _leaned_on(stage, place)
    objects = [""] if normals is None else list(normals)
    reach = _reach(stage.context)
    system = RowSystem(3 * len(objects) + 3)
    whole = np.zeros((6, system.size))
    ball = _touching(stage.context, normals, place)
    for i, name in enumerate(objects):
        own = slice(3 * i, 3 * i + 3)
        whole[:3, own] = np.eye(3)
        if name in ball:
            whole[3:, own] = pin.skew(ball[name])
    whole[3:, -3:] = reach * np.eye(3)
    about = whole.copy()
    lever = stage.kinematics.lever
    about[3:] -= pin.skew(lever) @ whole[:3]
    wanted = _wanted(stage, place.rotation)
    _add_set_points(stage, place.rotation, about, system)
    _add_limits(stage, about, wanted, system)
    if normals is not None:
        _add_contacts(stage, normals, wanted[:3], not ball, system)
    if place.q is not None:
        _add_torques(stage.context, place.q, whole, shares_of(stage).torque, system)
    guess = np.zeros(system.size)
    at = 3 * objects.index(stage.contacts.main) if stage.contacts.main in objects else 0
    guess[at : at + 3] = wanted[:3]
    if not ball:
        guess[-3:] = (wanted[3:] + cross(lever, wanted[:3])) / reach
    return system, guess


def _leaned_on(stage: StagePlan, place: Place) -> dict[str, Vector] | None:
    """Outward normals (3,) of all that the tool may lean on; None where these cannot be told.

    Grips, mechanisms, equations and loose bodies return what no cone describes. Of shapes that
    are not flat the normal is known where a frame follows them. A pull along the normal is TS308.
    """
    context = stage.context
    task = context.loaded.task
    others = task.robot.grasp is not None or task.mechanisms or task.equations or task.bushings
    if others or not task.shapes or any(shape.free for shape in task.shapes.values()):
        return None
    if any(base.turns for base in context.moving_bases.values()):
        return None
    normals = {}
    for name, surface in context.surfaces.items():
        if name == stage.frame.surface_name:
            normals[name] = place.rotation[:, 2]
        elif surface.level:
            normals[name] = stage.contacts.normal(name)
        else:
            return None
    for axis, value in stage.set_points.constant.items():
        contact = stage.contacts.of(axis)
        if contact is None or axis.is_rotation:
            continue
        along = float(place.rotation[:, axis.column] @ stage.contacts.normal(contact))
        if abs(along) > MOSTLY and value * along > 0:
            return None
    return normals


def _limited(stage: StagePlan) -> bool:
    """Whether no force alone is beyond `limits.force`, which TS610 reports."""
    most, share = stage.limits.force, shares_of(stage).force
    own = [abs(value) for axis, value in stage.set_points.constant.items() if not axis.is_rotation]
    return most is not None and all(value <= share * most for value in own)


def _wanted(stage: StagePlan, rotation: Vector) -> Vector:
    """(6,) the set points alone, in the world's axes."""
    values = np.array([stage.set_points.constant.get(a, 0.0) for a in AXES])
    return np.concatenate([rotation @ values[:3], rotation @ values[3:]])


def _add_set_points(stage: StagePlan, rotation: Vector, about: Vector, system: RowSystem) -> None:
    inside = np.kron(np.eye(2), rotation.T) @ about
    for axis, value in stage.set_points.constant.items():
        key, dimension = axis.effort, axis.of(FORCE)
        text = f"{show(value, dimension)} {'about' if axis.is_rotation else 'along'} {axis!r}"
        place = FILE.stages[stage.name].axes[axis][key]
        cause = RowCause("set point", text, place, f"lower the {key}", value, dimension)
        system.add(inside[axis.row], value, value, cause)


def _add_limits(stage: StagePlan, about: Vector, wanted: Vector, system: RowSystem) -> None:
    limits, share = stage.limits, shares_of(stage).force
    parts = (("force", limits.force if _limited(stage) else None, 0, share),
             ("torque", limits.torque, 3, 1.0))  # fmt: skip
    for key, bound, first, part in parts:
        if bound is None:
            continue
        most = part * bound
        text = f"limits.{key}, {show(bound, Limits.dimension_of(key))}{kept(part)}"
        cause = RowCause("limit", text, limit_place(stage, key), "raise the limit")
        for direction in _directions(wanted[first : first + 3]):
            system.add(direction @ about[first : first + 3], -np.inf, most, cause)


def _add_contacts(
    stage: StagePlan,
    normals: Mapping[str, Vector],
    wanted: Vector,
    moments_too: bool,
    system: RowSystem,
) -> None:
    shapes, share = stage.context.loaded.task.shapes, shares_of(stage).friction
    moments = np.zeros((3, system.size))
    moments[:, -3:] = np.eye(3)
    lean = np.zeros(system.size)
    for i, (name, normal) in enumerate(normals.items()):
        own = slice(3 * i, 3 * i + 3)
        whole = shapes[name].friction
        friction = share * whole
        push = np.zeros(system.size)
        push[own] = -normal
        text = f"{name!r}, which can only push back"
        remedy = "press against the outward normal"
        cause = RowCause("contact", text, key_of(FILE.world[name]), remedy)
        system.add(push, 0.0, np.inf, cause)
        given = "friction" in shapes[name].model_fields_set
        place = FILE.world[name].friction
        text, remedy = f"the friction of {name!r}, {whole:g}{kept(share)}", "press harder"
        if not whole:
            text, remedy = f"{name!r}, which has no friction", "declare the friction it has"
        cause = RowCause("contact", text, place if given else key_of(place), remedy)
        for tangent in _tangents(normal, wanted):
            row = np.zeros(system.size)
            row[own] = tangent
            system.add(row - friction * push, -np.inf, 0.0, cause)
        lean += moments_too * np.hypot(1.0, friction) * push
    text, remedy = "the size of the tool's face", "press harder"
    if not moments_too:
        text, remedy = "a ball, which touches in one point and bears no moment", "take a flat tool"
    cause = RowCause("face", text, None, remedy)
    for row in (*moments, *-moments):
        system.add(row - lean, -np.inf, 0.0, cause)


def _add_torques(
    context: Context, q: Vector, whole: Vector, share: float, system: RowSystem
) -> None:
    robot = context.robot
    twin = robot.twin()
    gravity, J = twin.gravity(q), twin.resolved_jacobian(q)
    for i, most in enumerate(robot.torque_limit):
        if not np.isfinite(most):
            continue
        dimension = FORCE.on(rotation=turns_at(robot, i))
        text = f"joint {i + 1} ({show(float(most), dimension)}{kept(share)})"
        cause = RowCause(TORQUE, text, None, OTHERWISE)
        # Gravity alone is always allowed.
        low, high = min(-share * most - gravity[i], 0.0), max(share * most - gravity[i], 0.0)
        if share == 1.0:
            low, high = -most - gravity[i], most - gravity[i]
        system.add(J[:, i] @ whole, low, high, cause)


def _directions(wanted: Vector) -> Iterable[Vector]:
    size = float(np.linalg.norm(wanted))
    return _AROUND if size == 0 else (*_AROUND, wanted / size)


def _tangents(normal: Vector, wanted: Vector) -> Iterable[Vector]:
    """Unit vectors (3,) across a normal, the first along what is wanted across it."""
    first = wanted - (normal @ wanted) * normal
    if np.linalg.norm(first) < 1e-9 * max(1.0, float(np.linalg.norm(wanted))):
        first = cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    first = first / np.linalg.norm(first)
    second = cross(normal, first)
    for k in range(_FACES):
        angle = 2 * np.pi * k / _FACES
        yield np.cos(angle) * first + np.sin(angle) * second


def _touching(
    context: Context, normals: Mapping[str, Vector] | None, place: Place
) -> dict[str, Vector]:
    """From the tip to where a ball touches each object (3,); empty for flat tools [m]."""
    robot = context.robot
    if robot.tool.flat or place.q is None or normals is None:
        return {}
    R = robot.twin().tip(place.q).rotation
    center, radius = R @ robot.tool.centers[0], robot.tool.radii[0]
    return {name: center - radius * normal for name, normal in normals.items()}


def _reach(context: Context) -> float:
    """The farthest that the tool touches from its tip [m]."""
    tool = context.robot.tool
    return float(np.max(np.linalg.norm(tool.centers, axis=1) + tool.radii))
