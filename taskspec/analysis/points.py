"""Where the spheres of the tool touch an object."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.context import Context
from taskspec.program.world import frames
from taskspec.spec import Task

Matrix = NDArray[np.float64]


def normal_at(
    context: Context, task: Task, name: str, center: Matrix, radius: float
) -> tuple[Matrix, Matrix]:
    """Outward normal (3,) at a sphere of the tool that touches, and its change (3, 3) [1/m]."""
    surface = frames.surface(task.shapes[name])
    x = ca.SX.sym("x", 3)
    gradient = surface.gradient(x)
    function = ca.Function("normal", [x], [gradient, ca.jacobian(gradient, x), surface.distance(x)])
    A, a = np.eye(3), np.zeros(3)
    if name in context.moving_bases:
        A, a = context.moving_bases[name].pose(0.0)
    local = A.T @ (center - a)
    normal, _, distance = (np.array(part) for part in function(local))
    # The normal's change is that of the tool brought to the surface.
    touching = local - (float(distance[0, 0]) - radius) * normal.ravel()
    normal, bend, _ = (np.array(part) for part in function(touching))
    return A @ normal.ravel(), A @ bend @ A.T


def skew(v: Matrix) -> Matrix:
    """S(v) (3, 3) with S(v) w = v x w."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
