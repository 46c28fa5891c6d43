"""Which axes of a frame an arm can move along and about."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis

_ALIGNMENT_TOLERANCE = 1e-6
#: An axis is along a normal if it carries at least half of the square of a force along that.
MOSTLY = 0.7071


class SkewedAxisError(ValueError):
    """A frame's axis is neither within the arm's motions nor free of them."""

    def __init__(self, axis: Axis) -> None:
        super().__init__(f"axis {axis!r} is askew to the plane in which the arm moves")
        self.axis = axis


def existing_axes(
    world_axes: tuple[Axis, ...], rotation: NDArray[np.float64], orthogonal: bool = True
) -> tuple[Axis, ...]:
    """The axes of a frame that exist for an arm.

    Args:
        world_axes: the world axes that the tip can move along and about.
        rotation: (3, 3) frame in the world.
        orthogonal: raise where an axis is only partly available.

    Raises:
        SkewedAxisError: the frame is not aligned with the arm's plane of motion.
    """
    available = []
    for name in AXES:
        block = AXES[3:] if name.is_rotation else AXES[:3]
        inside = np.array([a in world_axes for a in block], dtype=float)
        column = rotation[:, AXES.index(name) % 3]
        share = float(np.sum(inside * column**2))
        if share > 1 - _ALIGNMENT_TOLERANCE:
            available.append(name)
        elif share > _ALIGNMENT_TOLERANCE and orthogonal:
            raise SkewedAxisError(name)
    return tuple(available)
