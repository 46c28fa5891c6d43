"""What bears the forces of a stage: contacts along normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.plan import StagePlan
from taskspec.program.world.touch import WholeTool

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Bearing:
    """Contacts that a stage presses on or yields to.

    Attributes:
        names: of the objects.
        normals: (3, k) outward, in the stage's axes.
        friction: the largest coefficient among them.
    """

    names: tuple[str, ...]
    normals: Vector
    friction: float


def bearing(plan: StagePlan) -> Bearing:
    """The contacts along a force axis of a stage, or along an axis that yields to them."""
    bear = {*plan.contacts.pressed, *plan.met}
    names = tuple(o for o in dict.fromkeys((*plan.contacts.touched, *plan.met)) if o in bear)
    normals = np.array([plan.rotation.T @ plan.contacts.normal(o) for o in names])
    shapes = plan.context.loaded.task.shapes
    rubs = max((shapes[o].friction for o in names), default=0.0)
    return Bearing(names, normals.reshape(-1, 3).T, rubs)


def gap_at_start(plan: StagePlan) -> float | None:
    """Distance to the contact of a stage as it starts [m]; None where it is unknown."""
    context, gap = plan.context, plan.nominal.gap
    first = plan.name == next(iter(context.loaded.task.stages))
    if gap is None and first and plan.contacts.main is not None and plan.moving_base is not None:
        return context.start_gaps[plan.contacts.main]
    return gap


def moment_arms(plan: StagePlan, normal: Vector) -> Vector:
    """(6,) what a unit force along a normal (3,) is at the control point, in the stage's axes.

    A flat tool touches with the middle of the face that lies flat, of the edge, or with the corner
    that is farthest against the normal, a ball in the point that is nearest to the object.
    """
    context = plan.context
    tool = context.robot.tool
    lever = -plan.kinematics.lever
    if tool.flat:
        lever = lever + WholeTool(tool).lever(context.start_R, plan.rotation @ normal)
    else:
        lever = lever + context.start_R @ tool.centers[0]
        lever = lever - float(tool.radii[0]) * (plan.rotation @ normal)
    return np.concatenate([normal, np.cross(plan.rotation.T @ lever, normal)])


def along(normals: Vector, axis: Axis) -> int | None:
    """The contact whose normal a translation is mostly along; None for none."""
    if axis.is_rotation or not normals.shape[1]:
        return None
    shares = np.abs(normals[axis.row])
    best = int(np.argmax(shares))
    return best if shares[best] > MOSTLY else None
