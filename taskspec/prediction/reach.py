"""What bears the forces of a stage: contacts along normals, what is held, equations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.prediction.at_start import StageAtStart
from taskspec.program.axes import MOSTLY
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


def bearing(here: StageAtStart) -> Bearing:
    """The contacts along a force axis of a stage, or along an axis that yields to them."""
    context, stage = here.context, here.stage
    plan = stage.plan
    bear = {*plan.contacts.pressed, *plan.met}
    names = tuple(o for o in dict.fromkeys((*plan.contacts.touched, *plan.met)) if o in bear)
    normals = np.array([here.rotation.T @ plan.contacts.normal(o) for o in names])
    shapes = context.loaded.task.shapes
    rubs = max((shapes[o].friction for o in names), default=0.0)
    return Bearing(names, normals.reshape(-1, 3).T, rubs)


def moment_arms(here: StageAtStart, normal: Vector) -> Vector:
    """(6,) what a unit force along a normal (3,) is at the control point, in the stage's axes.

    A flat tool touches with the middle of the face that lies flat, of the edge, or with the corner
    that is farthest against the normal, a ball in the point that is nearest to the object.
    """
    context = here.context
    tool = context.robot.tool
    lever = -here.stage.plan.kinematics.lever
    if tool.flat:
        lever = lever + WholeTool(tool).lever(context.start_R, here.rotation @ normal)
    else:
        lever = lever + context.start_R @ tool.centers[0]
        lever = lever - float(tool.radii[0]) * (here.rotation @ normal)
    return np.concatenate([normal, np.cross(here.rotation.T @ lever, normal)])


def along(normals: Vector, axis: Axis) -> int | None:
    """The contact whose normal a translation is mostly along; None for none."""
    if axis.is_rotation or not normals.shape[1]:
        return None
    shares = np.abs(normals[AXES.index(axis)])
    best = int(np.argmax(shares))
    return best if shares[best] > MOSTLY else None
