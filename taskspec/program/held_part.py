"""The loose body that the tool holds, as the run begins: its weight, and what is under it."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.robot.rebuild import GRAVITY
from taskspec.shapes import BoundedSurface

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class HeldPart:
    """A loose body that the tool holds as the run begins.

    Attributes:
        name: of the body.
        weight: (3,) what the robot applies to hold it against gravity, world axes [N].
        gaps: signed distance of the body from each other object [m].
    """

    name: str
    weight: Vector
    gaps: dict[str, float]

    @classmethod
    def of(cls, context: Context) -> HeldPart | None:
        """The one of a task; None where its tool holds none."""
        shapes = context.loaded.task.shapes
        name = context.loaded.task.robot.grasp or ""
        body = shapes.get(name)
        if body is None or not body.free or body.mass is None:
            return None
        others = [other for other in shapes if other != name]
        gaps = {other: distance(context, name, other) for other in others}
        return cls(name, -body.mass * np.array(GRAVITY), gaps)

    def below(self, contact: str, tool: float) -> float:
        """By how much the body is nearer to an object than the tool is, as the run begins [m].

        Args:
            contact: the object; 0 for the body itself.
            tool: distance of the tool from it [m].
        """
        return tool - self.gaps[contact] if contact in self.gaps else 0.0

    @property
    def hangs(self) -> bool:
        """Whether nothing else touches it, so that the tool bears its whole weight."""
        return all(gap > 0.0 for gap in self.gaps.values())


def distance(context: Context, name: str, other: str) -> float:
    """Signed distance [m] of the points that a body reaches farthest with from another object.

    Args:
        context: as the run begins.
        name: of a loose body.
        other: of an object.
    """
    body = context.surfaces[name]
    assert isinstance(body, BoundedSurface)
    own, radius = body.extremes()
    points = body.origin + own @ body.rotation.T
    base = context.moving_bases.get(other)
    if base is not None:
        A, a = base.pose(0.0)
        points = (points - a) @ A
    surface = context.surfaces[other]
    return min(float(ca.evalf(surface.distance(ca.SX(p)))) for p in points) - radius
