"""Surfaces of constraint equations: planes, cylinders and spheres that stand still."""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.program.world.equations import EquationModel

Vector = NDArray[np.float64]

_HALF_THICKNESS, _MARGIN = 5e-4, 0.04
_TOLERANCE = 1e-6
#: A larger radius than this [m] is not drawn.
_LARGEST_RADIUS = 2.0


@dataclass(frozen=True, slots=True)
class DrawnSurface:
    """A geom of MuJoCo: kind, half sizes (3,) [m], pose (3,), (3, 3) in the world."""

    kind: mujoco.mjtGeom
    size: Vector
    center: Vector
    rotation: Vector


def equation_surfaces(models: Iterable[EquationModel], tip: Vector) -> list[DrawnSurface]:
    """The surfaces of the equations that are simple; the others are left out.

    Args:
        models: the equations.
        tip: (n, 3) the tool's path [m], around which a surface is shown.
    """
    found = [_surface(model, tip) for model in models if not (model.joints or model.turns)]
    return [surface for surface in found if surface is not None]


def _surface(model: EquationModel, tip: Vector) -> DrawnSurface | None:
    """r = x^T A x / 2 + b^T x + c with A = 0, or A of two or three equal eigenvalues."""
    x, clock = ca.SX.sym("x", 3), ca.SX.sym("clock")
    R = model.rotation
    # The residual takes a place in the world; here x counts in the equation's frame.
    r = model.residual(ca.DM(R) @ x + ca.DM(model.origin), clock)
    hessian, gradient = ca.hessian(r, x)
    terms = ca.Function("terms", [x, clock], [hessian, gradient, r, ca.jacobian(r, clock)])
    local = (tip - model.origin) @ R
    A, b, c, moves = (np.array(v) for v in terms(np.zeros(3), 0.0))
    if np.any(moves) or not np.isfinite(A).all():
        return None
    for place in (local[0], local[-1] + 0.1, np.array([0.3, -0.2, 0.5])):
        other, _, _, moves = (np.array(v) for v in terms(place, 1.0))
        if np.any(moves) or not np.allclose(other, A, rtol=1e-6, atol=1e-9):
            return None
    values, vectors = np.linalg.eigh(A)
    size = float(np.abs(values).max())
    if size < 1e-9:
        return _plane(model, local, b.ravel(), float(c.item()))
    flat = np.abs(values) < _TOLERANCE * size
    round_ = values[~flat]
    if not np.allclose(round_, round_[0], rtol=_TOLERANCE) or len(round_) < 2:
        return None
    vectors = vectors[:, np.argsort(flat, kind="stable")]
    return _round(
        model, local, (float(round_[0]), vectors, b.ravel(), float(c.item())), len(round_)
    )


def _plane(model: EquationModel, local: Vector, b: Vector, c: float) -> DrawnSurface:
    normal = b / np.linalg.norm(b)
    foot = -c / float(np.linalg.norm(b)) * normal
    across = _axes_about(normal)
    on = (local - foot) @ across
    low, high = on.min(axis=0) - _MARGIN, on.max(axis=0) + _MARGIN
    half = np.array([*(high - low)[:2] / 2, _HALF_THICKNESS])
    center = foot + across[:, :2] @ ((high + low)[:2] / 2)
    return _placed(model, mujoco.mjtGeom.mjGEOM_BOX, half, center, across)


def _round(
    model: EquationModel,
    local: Vector,
    terms: tuple[float, Vector, Vector, float],
    dimensions: int,
) -> DrawnSurface | None:
    """A cylinder or sphere of a x^2 / 2 + b x + c over two or three of its axes."""
    a, vectors, b, c = terms
    along = vectors.T @ b
    if dimensions == 2 and abs(along[2]) > _TOLERANCE:
        return None
    middle = -along / a
    middle[dimensions:] = 0.0
    squared = float(middle @ middle) - 2 * c / a
    if not 0.0 < squared < _LARGEST_RADIUS**2:
        return None
    radius = float(np.sqrt(squared))
    if dimensions == 3:
        half, kind = np.full(3, radius), mujoco.mjtGeom.mjGEOM_SPHERE
    else:
        on = local @ vectors[:, 2]
        middle[2] = (on.min() + on.max()) / 2
        half = np.array([radius, radius, (on.max() - on.min()) / 2 + _MARGIN / 2])
        kind = mujoco.mjtGeom.mjGEOM_CYLINDER
    axes = vectors * np.sign(np.linalg.det(vectors))
    return _placed(model, kind, half, vectors @ middle, axes)


def _placed(
    model: EquationModel, kind: mujoco.mjtGeom, half: Vector, center: Vector, axes: Vector
) -> DrawnSurface:
    rotation = np.ascontiguousarray(model.rotation @ axes)
    return DrawnSurface(kind, half, model.origin + model.rotation @ center, rotation)


def _axes_about(normal: Vector) -> Vector:
    """(3, 3) right-handed axes with z along a unit vector."""
    other = np.eye(3)[int(np.argmin(np.abs(normal)))]
    x = np.cross(other, normal)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(normal, x), normal])
