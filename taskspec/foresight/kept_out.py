"""How far objects keep an arm from following a reference that leads the tool's end into them."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.bound import RowFunction
from taskspec.shapes import BoundedSurface, Surface

Vector = NDArray[np.float64]

#: What counts as touching [m].
_TOUCH = 1e-6
#: Steps of a march along a normal: across a face one does, near a grazed edge they get short.
_STEPS = 60


class KeptOut:
    """What keeps the tool's end out of objects that stand still, configuration after configuration.

    Where the tool's end comes into an object, that object keeps it on the side on which it came:
    along the normal there, until nothing on that side keeps it any more. So it is out of a thin
    box even where the reference is past its middle, or beyond it.
    """

    def __init__(self, surfaces: Sequence[Surface], radii: Vector) -> None:
        """Takes the objects, and the radii (b,) of the balls of the tool's end [m]."""
        x = ca.SX.sym("x", 3)
        each = [(s.distance(x), s.gradient(x)) for s in surfaces]
        self._distances = [RowFunction(ca.Function("d", [x], [d])) for d, _ in each]
        self._gradients = [RowFunction(ca.Function("n", [x], [n])) for _, n in each]
        self._sizes = [_size(surface) for surface in surfaces]
        self._origins = [surface.origin for surface in surfaces]
        self._radii = radii
        self._normals: dict[int, Vector] = {}
        self._last: Vector | None = None

    def forget(self) -> None:
        """The arm goes on in a way that is not known."""
        self._normals.clear()
        self._last = None

    def follow(self, centers: Vector, gaps: Vector) -> Vector:
        """How far the arm is kept back, world, at the next configurations.

        Args:
            centers: (k, b, 3) of the balls of the tool's end [m].
            gaps: (k, b, objects) of these balls [m], negative inside.

        Returns:
            (k, 3) [m].
        """
        kept = np.zeros((len(centers), 3))
        for thing in range(gaps.shape[2]):
            kept += self._by(thing, centers, gaps[:, :, thing])
        self._last = centers[-1]
        return kept

    def _by(self, thing: int, centers: Vector, gaps: Vector) -> Vector:
        """(k, 3) what one object keeps it back by; remembers whether it still does at the end."""
        kept = np.zeros((len(centers), 3))
        inside = gaps.min(axis=1) < -_TOUCH
        k = 0
        while k < len(centers):
            normal = self._normals.get(thing)
            if normal is None:
                if not inside[k:].any():
                    break
                k += int(np.argmax(inside[k:]))
                before = centers[k - 1] if k else self._last
                ball = int(np.argmin(gaps[k]))
                at = (centers[k] if before is None else before)[ball]
                normal = self._gradients[thing](at[np.newaxis])[0][0]
                if not np.isfinite(normal).all() or not normal.any():
                    break
                self._normals[thing] = normal
            back = self._back(thing, centers[k:], normal)
            free = back <= _TOUCH
            end = int(np.argmax(free)) if free.any() else len(free)
            kept[k : k + end] = back[:end, np.newaxis] * normal
            if end < len(free):
                del self._normals[thing]
            k += end
        return kept

    def _back(self, thing: int, centers: Vector, normal: Vector) -> Vector:
        """(k,) how far along a normal balls (k, b, 3) are outside for the first time [m].

        A signed distance is never more than the way to the surface, so marching by it stops
        there. A convex object of some size is come to from outside, so that what is beyond it is
        held as well; of others the way out is looked for from within.
        """
        count, radii = len(centers), np.tile(self._radii, len(centers))
        points = centers.reshape(-1, 3)
        size = self._sizes[thing]
        if size is None:
            way, sign = np.zeros(len(points)), 1.0
        else:
            far = np.linalg.norm(points - self._origins[thing], axis=1)
            way, sign = far + size + radii, -1.0
        todo = np.arange(len(points))
        for _ in range(_STEPS):
            found = self._distances[thing](points[todo] + way[todo, np.newaxis] * normal)[0][:, 0]
            gap = found - radii[todo]
            way[todo] -= gap if sign < 0 else np.minimum(gap, 0.0)
            todo = todo[(np.abs(gap) if sign < 0 else -gap) > 0.1 * _TOUCH]
            todo = todo[way[todo] > 0] if sign < 0 else todo
            if not todo.size:
                break
        back: Vector = np.maximum(way, 0.0).reshape(count, -1).max(axis=1)
        return back


def _size(surface: Surface) -> float | None:
    """How far a convex object of finite size reaches from its origin [m]; None of others."""
    if not isinstance(surface, BoundedSurface):
        return None
    points, radius = surface.extremes()
    return float(np.linalg.norm(points, axis=1).max()) + radius
