"""The shapes of the world as signed distances: one source for compiler, checks, gap and log.

A surface is written on CasADi expressions of a point in world coordinates. Its dimensions are
numbers: the believed ones in the controller, the true ones in the plant.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Surface:
    """A posed shape.

    Attributes:
        kind: plane, box, cylinder or sphere.
        origin: (3,) [m], world.
        rotation: (3, 3), columns are the shape's own axes in the world.
        half: (3,) [m] half edges of a box; (radius, radius, half length) of a cylinder;
            (radius, radius, radius) of a sphere; unused by a plane.
    """

    kind: str
    origin: NDArray[np.float64]
    rotation: NDArray[np.float64]
    half: NDArray[np.float64]

    def local(self, point: ca.SX) -> ca.SX:
        """The world point (3,) in the shape's own coordinates (3,) [m]."""
        return ca.DM(self.rotation.T) @ (point - ca.DM(self.origin))

    def distance(self, point: ca.SX) -> ca.SX:
        """Signed distance [m] of a world point (3,) from the solid shape, positive outside."""
        x = self.local(point)
        if self.kind == "plane":
            return x[2]
        if self.kind == "sphere":
            return ca.norm_2(x) - self.half[0]
        if self.kind == "cylinder":
            excess = ca.vertcat(_radius(x) - self.half[0], ca.fabs(x[2]) - self.half[2])
        else:
            excess = ca.fabs(x) - ca.DM(self.half)
        outside = ca.sqrt(ca.sumsqr(ca.fmax(excess, 0)) + 1e-30)
        return outside + ca.fmin(ca.mmax(excess), 0)

    def gradient(self, point: ca.SX) -> ca.SX:
        """Direction (3,), world, in which the distance grows: the outward normal."""
        x = ca.SX.sym("x", 3)
        gradient = ca.Function("gradient", [x], [ca.gradient(self.distance(x), x)])
        return gradient(point)

    def face(self, point: NDArray[np.float64]) -> int:
        """The face of a box nearest to a world point: 0..2 for +x..+z, 3..5 for -x..-z."""
        x = self.rotation.T @ (np.asarray(point) - self.origin)
        axis = int(np.argmax(np.abs(x) - self.half))
        return axis if x[axis] >= 0 else axis + 3

    def chart(self, face: ca.SX | None = None) -> Chart:
        """The smooth part of the surface that a following frame moves on.

        Args:
            face: for a box, (3, 3) rotation whose z is the face's outward normal, followed by
                (3,) centre and (2,) half extents: 14 numbers chosen when the stage is entered.
        """
        return Chart(self, face)


def _radius(x: ca.SX) -> ca.SX:
    return ca.sqrt(x[0] ** 2 + x[1] ** 2 + 1e-30)


def box_face(surface: Surface, index: int) -> NDArray[np.float64]:
    """The 14 numbers of a box face: rotation (column-major), centre, half extents along x and y.

    x is the box's own x on the z and y faces and its own y on the x faces, so that it always
    lies in the face.
    """
    axis, sign = index % 3, 1.0 if index < 3 else -1.0
    x_axis = 1 if axis == 0 else 0
    z = sign * surface.rotation[:, axis]
    x = surface.rotation[:, x_axis]
    y = np.cross(z, x)
    y_axis = 3 - axis - x_axis
    center = surface.origin + surface.half[axis] * z
    R = np.column_stack([x, y, z])
    return np.concatenate(
        [R.ravel(order="F"), center, [surface.half[x_axis], surface.half[y_axis]]]
    )


@dataclass(frozen=True, slots=True)
class Chart:
    """Distance, foot, normal and frame of the part of a surface that the tool follows."""

    surface: Surface
    face: ca.SX | None

    @property
    def flat(self) -> bool:
        """Whether the normal is the same everywhere on the chart."""
        return self.surface.kind in ("plane", "box")

    def distance(self, point: ca.SX) -> ca.SX:
        """Signed distance [m] from the chart, continued beyond its edges."""
        kind = self.surface.kind
        if kind == "box":
            assert self.face is not None
            return ca.dot(self.face[6:9], point - self.face[9:12])
        if kind == "cylinder":
            return _radius(self.surface.local(point)) - float(self.surface.half[0])
        return self.surface.distance(point)

    def normal(self, point: ca.SX) -> ca.SX:
        """Outward unit normal (3,), world, at the foot of a world point (3,)."""
        surface = self.surface
        if surface.kind == "plane":
            return ca.SX(ca.DM(surface.rotation[:, 2]))
        if surface.kind == "box":
            assert self.face is not None
            return self.face[6:9]
        x = surface.local(point)
        if surface.kind == "cylinder":
            n = ca.vertcat(x[0], x[1], 0) / _radius(x)
        else:
            n = x / ca.sqrt(ca.sumsqr(x) + 1e-30)
        return ca.DM(surface.rotation) @ n

    def foot(self, point: ca.SX) -> ca.SX:
        """The surface point (3,) [m], world, nearest to a world point (3,)."""
        return point - self.distance(point) * self.normal(point)

    def frame(self, point: ca.SX, heading: NDArray[np.float64] | None) -> ca.SX:
        """The following frame (3, 3) at the foot of a point: z the outward normal.

        x is `heading` (world, (3,)) laid on the tangent plane, by default the surface's own x,
        for a cylinder its axis (docs/language.md).
        """
        n = self.normal(point)
        x = _tangent(ca.SX(self.reference_direction(heading)), n)
        return ca.horzcat(x, ca.cross(n, x), n)

    def reference_direction(self, heading: NDArray[np.float64] | None) -> ca.SX:
        """The world direction (3,) that is laid on the tangent plane to become x."""
        if heading is not None:
            return ca.SX(ca.DM(np.asarray(heading, dtype=float)))
        if self.surface.kind == "box":
            assert self.face is not None
            return self.face[0:3]
        column = 2 if self.surface.kind == "cylinder" else 0
        return ca.SX(ca.DM(self.surface.rotation[:, column]))

    def margin(self, point: ca.SX, heading: NDArray[np.float64] | None) -> ca.SX:
        """Positive while the foot is on the chart.

        Inside the face of a box, between the ends of a cylinder, and away from the points where x
        is undefined (the poles of a sphere).
        """
        kind = self.surface.kind
        if kind == "plane":
            return ca.SX(1)
        if kind == "box":
            assert self.face is not None
            offset = point - self.face[9:12]
            return ca.fmin(
                self.face[12] - ca.fabs(ca.dot(self.face[0:3], offset)),
                self.face[13] - ca.fabs(ca.dot(self.face[3:6], offset)),
            )
        n, x = self.normal(point), self.reference_direction(heading)
        pole = 1 - ca.fabs(ca.dot(n, x)) / ca.norm_2(x) - 1e-3
        if kind == "sphere":
            return pole
        return ca.fmin(pole, self.surface.half[2] - ca.fabs(self.surface.local(point)[2]))


def _tangent(direction: ca.SX, n: ca.SX) -> ca.SX:
    x = direction - ca.dot(direction, n) * n
    return x / ca.sqrt(ca.sumsqr(x) + 1e-30)
