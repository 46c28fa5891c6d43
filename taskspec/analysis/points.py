"""Where the spheres of the tool touch an object."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.program.context import Context
from taskspec.program.world import frames
from taskspec.spec import Task

Matrix = NDArray[np.float64]


class Touched:
    """The surface of an object where spheres of the tool touch it.

    Args:
        context: for the object's pose where it moves.
        task: whose object is the true one.
        name: of the object.
    """

    def __init__(self, context: Context, task: Task, name: str) -> None:
        self._shape = task.shapes[name]
        self._A, self._a = np.eye(3), np.zeros(3)
        if name in context.moving_bases:
            self._A, self._a = context.moving_bases[name].pose(0.0)

    def normal_at(self, center: Matrix, radius: float) -> tuple[Matrix, Matrix]:
        """Outward normal (3,) at a sphere that touches, and its change (3, 3) [1/m]."""
        A = self._A
        local = A.T @ (center - self._a)
        normal, _, distance = frames.normal_at(self._shape, local)
        # The normal's change is that of the tool brought to the surface.
        touching = local - (distance - radius) * normal
        normal, bend, _ = frames.normal_at(self._shape, touching)
        return A @ normal, A @ bend @ A.T


def skew(v: Matrix) -> Matrix:
    """S(v) (3, 3) with S(v) w = v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
