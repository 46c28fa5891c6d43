"""The box, of which a frame follows one face."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.surface import (
    POINT_RADIUS,
    SIZE,
    Geom,
    SurfaceChart,
    ToolEnd,
    ToolSurface,
    outside,
)

if TYPE_CHECKING:
    from taskspec.shapes.surface import Vector


@dataclass(frozen=True, eq=False)
class Box(ToolSurface):
    """A box about its origin.

    Attributes:
        size: (3,) full edges [m].
    """

    size: Sequence[float]

    name = "box"
    keys = (SIZE,)
    flat = True
    start_over = "over the face of a box"
    parts = "faces"
    face_size = 14
    resting_points = 4
    tool_keys = {"size": True}  # noqa: RUF012

    @property
    def half(self) -> Vector:
        """(3,) half edges [m]."""
        return np.array(self.size) / 2

    @property
    def half_sizes(self) -> Vector:
        """(3,) half edges [m]."""
        return self.half

    def support(self, n: ca.SX) -> ca.SX:
        """To its farthest corner."""
        return ca.dot(ca.DM(self.half), ca.fabs(n))

    def flat_along(self, n: ca.SX) -> ca.SX:
        """Its faces."""
        return 1 - n**2

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from the nearest face, edge or corner."""
        return outside(ca.fabs(x) - ca.DM(self.half))

    def chart(self, face: ca.SX | None = None) -> SurfaceChart:
        """The face that the numbers describe, as a chart."""
        assert face is not None
        return BoxFace(face)

    def face_at(self, point: ca.SX) -> ca.SX | None:
        """(14,) the nearest face."""
        x = self.local(point)
        excess = ca.fabs(x) - ca.DM(self.half)
        sides = [
            ca.if_else(x[i] >= 0, ca.DM(self.face(i)), ca.DM(self.face(i + 3))) for i in range(3)
        ]
        found, most = sides[0], excess[0]
        for side, beyond in zip(sides[1:], (excess[1], excess[2]), strict=True):
            found = ca.if_else(beyond > most, side, found)
            most = ca.fmax(most, beyond)
        return found

    def face(self, index: int) -> Vector:
        """(14,) face 0..2 for +x..+z, 3..5 for -x..-z: rotation, centre, half edges along x and y.

        z of the rotation is the outward normal. x is the box's own x on the z and y faces and its
        own y on the x faces, so that it always lies in the face.
        """
        axis, sign = index % 3, 1.0 if index < 3 else -1.0
        x_axis = 1 if axis == 0 else 0
        z = sign * self.rotation[:, axis]
        x = self.rotation[:, x_axis]
        y = np.cross(z, x)
        y_axis = 3 - axis - x_axis
        center = self.origin + self.half[axis] * z
        R = np.column_stack([x, y, z])
        return np.concatenate([R.ravel(order="F"), center, [self.half[x_axis], self.half[y_axis]]])

    def geom(self) -> Geom:
        """A box with these half edges."""
        x, y, z = (edge / 2 for edge in self.size)
        return Geom("box", (x, y, z))

    @property
    def volume(self) -> float:
        """Volume of the box [m^3]."""
        return float(8.0 * np.prod(self.half))

    def inertia(self, mass: float) -> list[float]:
        """Moments (3,) [kg m^2] of a box."""
        x, y, z = np.square(self.size)
        return [float(mass * s / 12) for s in (y + z, x + z, x + y)]

    def contact_points(self) -> tuple[Vector, float]:
        """A small sphere at each corner."""
        half = self.half
        point = min(POINT_RADIUS, float(half.min()) / 4)
        signs = np.array(np.meshgrid(*[(-1, 1)] * 3, indexing="ij")).reshape(3, -1).T
        return signs * (half - point), point

    def extremes(self) -> tuple[Vector, float]:
        """The eight corners, with a radius of 0."""
        return np.array(list(product((-0.5, 0.5), repeat=3))) * self.size, 0.0

    @classmethod
    def tool_end(
        cls,
        radius: float,  # noqa: ARG003
        size: Sequence[float],
        thickness: float,  # noqa: ARG003
    ) -> ToolEnd:
        """A face with a small sphere at each corner."""
        x, y, z = (edge / 2 for edge in size)
        point = min(POINT_RADIUS, x / 4, y / 4)
        signs = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
        centers = np.column_stack((signs * (x - point, y - point), np.full(4, -point)))
        solid = cls(np.zeros(3), np.eye(3), size)
        return ToolEnd(solid, -z, min(x, y), 2 * -z, centers, np.full(4, point))


@dataclass(frozen=True, eq=False)
class BoxFace(SurfaceChart):
    """One face of a box.

    Attributes:
        numbers: (14,) as `Box.face` has them.
    """

    numbers: ca.SX

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance [m] from the plane of the face."""
        return ca.dot(self.numbers[6:9], point - self.numbers[9:12])

    def normal(self, point: ca.SX) -> ca.SX:  # noqa: ARG002
        """The z axis of the face (3,), world."""
        return self.numbers[6:9]

    def own_x(self) -> ca.SX:
        """The x axis of the face (3,), world."""
        return self.numbers[0:3]

    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:  # noqa: ARG002
        """Distance [m] to the nearest edge, positive inside the face."""
        offset = point - self.numbers[9:12]
        return ca.fmin(
            self.numbers[12] - ca.fabs(ca.dot(self.numbers[0:3], offset)),
            self.numbers[13] - ca.fabs(ca.dot(self.numbers[3:6], offset)),
        )
