"""What the world can return to the tool: spaces of forces and of moments.

A set point on an axis a is resisted if some wrench of the space W does work along a, that is a^T W
is not zero. Spaces of force and motion are never compared with each other by angles, whose units
differ.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan
from taskspec.program.world.equations import EquationModel

Vector = NDArray[np.float64]

#: Smallest share of a direction that counts as resisted: an axis is no more exact than 1 deg.
_RESISTED = np.sin(np.deg2rad(1.0))
#: How far around the start the gradients of an equation are looked at [m].
_AROUND = 0.1
_ALL = np.eye(3)
_NONE = np.zeros((3, 0))


def resists(stage: StagePlan, axis: Axis) -> bool:
    """Whether anything in the world returns a force along an axis, or a moment about it."""
    space = _moments(stage) if axis.is_rotation else _forces(stage)
    return bool(np.linalg.norm(stage.rotation[:, axis.column] @ space) > _RESISTED)


def _forces(stage: StagePlan) -> Vector:
    """(3, k) directions in which the world can return a force to the tip, world axes.

    A shape whose normal is not known everywhere counts as returning all, and so does what the
    robot holds: along the way that a mechanism leaves open its own dynamics resist.
    """
    context, followed = stage.context, stage.frame.surface_name
    task = context.loaded.task
    if task.robot.grasp is not None or any(m.joints for m in context.equations.values()):
        return _ALL
    columns = [_NONE]
    for name, shape in task.shapes.items():
        moves = name in context.moving_bases and context.moving_bases[name].turns
        level = context.surfaces[name].level and not shape.gives_way and not moves
        if shape.friction > 0 or not (level or name == followed):
            return _ALL
        normal = stage.rotation[:, 2] if name == followed else stage.contacts.normal(name)
        columns.append(normal[:, None])
    columns += [gradients(context, model)[:3] for model in context.equations.values()]
    columns += [wrenches[:3] for wrenches in _bushings(context)]
    return _basis(np.hstack(columns))


def _moments(stage: StagePlan) -> Vector:
    """(3, k) directions about which the world can return a moment to the control point.

    A ball touches in one point, which bears no moment there, nor does an equation but one on the
    tip's rotation. A free knob bears none about its own axis.
    """
    context = stage.context
    task = context.loaded.task
    if stage.frame.at_origin or any(m.joints for m in context.equations.values()):
        return _ALL
    if task.robot.grasp is not None:
        held = context.mechanisms.get(context.held)
        if held is None or not held.free:
            return _ALL
        axis = held.rotation[:, 2]
        return _basis(np.eye(3) - np.outer(axis, axis))
    if task.shapes and context.robot.tool.flat:
        return _ALL
    turning = (m for m in context.equations.values() if m.turns)
    moments = [gradients(context, model)[3:] for model in turning]
    for wrenches in _bushings(context):
        levers = np.cross(-stage.kinematics.lever, wrenches[:3], axisb=0, axisc=0)
        moments.append(wrenches[3:] + levers)
    return _basis(np.hstack([_NONE, *moments]))


def _bushings(context: Context) -> Iterator[Vector]:
    """(6, r) wrenches that each bushing returns to the tip, each of the stiffness' own size."""
    for model in context.bushings.values():
        values, modes = np.linalg.eigh(model.stiffness)
        kept = modes[:, values > _RESISTED * values[-1]]
        yield model.spring(context.start_p, context.start_R).J.T @ kept


def gradients(context: Context, model: EquationModel) -> Vector:
    """(3, k) unit gradients of an equation at the start and around it; (6, k) of one that turns.

    Such a one is taken in the rotation of the start.
    """
    p, R = ca.SX.sym("p", 3), ca.SX(context.start_R)
    normal = ca.Function(
        "normal", [p], [model.terms(model.place(ca.SX(context.start), p, R), ca.SX(0)).normal]
    )
    offsets = _AROUND * np.array([*product((-1.0, 0.3, 1.0), repeat=3)])
    normals = [np.array(normal(context.start_p + d)).ravel() for d in (np.zeros(3), *offsets)]
    finite = [n for n in normals if np.isfinite(n).all()]
    if len(finite) == len(normals):
        return np.array(finite).T
    return np.eye(6) if model.turns else _ALL


def _basis(columns: Vector) -> Vector:
    """An orthonormal basis (3, r) of the span of columns (3, k)."""
    if columns.shape[1] == 0:
        return _NONE
    U, sizes, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(U[:, sizes > _RESISTED * sizes[0]])
