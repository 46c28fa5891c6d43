"""The cylinder, of which a frame follows the side."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.round_patch import PATCH_KEYS, CylinderSegment, Tube, fixed_part, patch
from taskspec.shapes.surface import (
    LENGTH_OF,
    POINT_RADIUS,
    RADIUS,
    RIM_POINTS,
    Geom,
    Surface,
    SurfaceChart,
    ToolEnd,
    ToolSurface,
    outside,
    radius_about_z,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from taskspec.shapes.surface import Vector


@dataclass(frozen=True, eq=False)
class Cylinder(ToolSurface):
    """A cylinder about its z.

    Attributes:
        radius: [m].
        length: from end to end [m].
    """

    radius: float
    length: float

    name = "cylinder"
    keys = (RADIUS, LENGTH_OF, *PATCH_KEYS)
    optional = tuple(key.name for key in PATCH_KEYS)
    start_over = "over the side of a cylinder, or off the axis of a tube"
    resting_points = RIM_POINTS
    tool_keys = {"radius": True, "thickness": False}  # noqa: RUF012

    @classmethod
    def placed(cls, origin: Vector, rotation: Vector, sizes: Mapping[str, Any]) -> Surface:
        """A cylinder; a segment where there is an arc; from within a tube, by default all round."""
        return patch(origin, rotation, sizes, cls, CylinderSegment, Tube, 2 * np.pi)

    @classmethod
    def fixed(cls, data: Mapping[str, Any]) -> str:
        """Of a part alone."""
        return fixed_part(data)

    @property
    def half_sizes(self) -> Vector:
        """(3,) radius, radius, half length [m]."""
        return np.array([self.radius, self.radius, self.length / 2])

    def support(self, n: ca.SX) -> ca.SX:
        """To the rim of an end."""
        across = ca.sqrt(ca.fmax(1 - n[2] ** 2, 0.0))
        return self.radius * across + self.length / 2 * ca.fabs(n[2])

    def flat_along(self, n: ca.SX) -> ca.SX:
        """Along its axis at the side, across it at an end."""
        end = n[2] ** 2
        return ca.vertcat(end * (1 - n[0] ** 2), end * (1 - n[1] ** 2), 1 - end)

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from the side, an end or a rim."""
        return outside(ca.vertcat(radius_about_z(x) - self.radius, ca.fabs(x[2]) - self.length / 2))

    def chart(self, face: ca.SX | None = None) -> SurfaceChart:  # noqa: ARG002
        """The curved side of the cylinder."""
        return CylinderSide(self)

    def geom(self) -> Geom:
        """A cylinder with this radius and half length."""
        return Geom("cylinder", (self.radius, self.length / 2, 0.0))

    @property
    def volume(self) -> float:
        """Volume of the cylinder [m^3]."""
        return float(2 * np.pi * np.prod([self.radius, self.radius, self.length / 2]))

    def inertia(self, mass: float) -> list[float]:
        """Moments (3,) [kg m^2] of a cylinder."""
        r = self.radius
        across = mass * (r**2 / 4 + self.length**2 / 12)
        return [across, across, mass * r**2 / 2]

    def contact_points(self) -> tuple[Vector, float]:
        """Small spheres at both rims."""
        r, z = self.radius, self.length / 2
        point = min(POINT_RADIUS, r / 4, z / 4)
        rim = _rim(r - point)
        ends = [np.column_stack((rim, np.full(RIM_POINTS, s * (z - point)))) for s in (-1, 1)]
        return np.vstack(ends), point

    def extremes(self) -> tuple[Vector, float]:
        """Points of both rims."""
        z = self.length / 2
        return np.array([(x, y, end) for x, y in _rim(self.radius) for end in (-z, z)]), 0.0

    @classmethod
    def tool_end(
        cls,
        radius: float,
        size: Sequence[float],  # noqa: ARG003
        thickness: float,
    ) -> ToolEnd:
        """A round face with small spheres at its rim."""
        z = thickness / 2
        point = min(POINT_RADIUS, radius / 4, z)
        centers = np.column_stack((_rim(radius - point), np.full(RIM_POINTS, -point)))
        solid = cls(np.zeros(3), np.eye(3), radius, 2 * z)
        return ToolEnd(solid, -z, radius, 2 * -z, centers, np.full(RIM_POINTS, point))


def _rim(radius: float) -> Vector:
    """(RIM_POINTS, 2) points of a circle [m]."""
    angles = 2 * np.pi * np.arange(RIM_POINTS) / RIM_POINTS
    return radius * np.column_stack((np.cos(angles), np.sin(angles)))


@dataclass(frozen=True, eq=False)
class CylinderSide(SurfaceChart):
    """The side of a cylinder, without its ends."""

    cylinder: Cylinder

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance [m] from the side, continued beyond the ends."""
        return radius_about_z(self.cylinder.local(point)) - self.cylinder.radius

    def normal(self, point: ca.SX) -> ca.SX:
        """Unit vector (3,) away from the axis, world."""
        x = self.cylinder.local(point)
        n = ca.vertcat(x[0], x[1], 0) / radius_about_z(x)
        return ca.DM(self.cylinder.rotation) @ n

    def own_x(self) -> ca.SX:
        """The cylinder's axis (3,)."""
        return ca.SX(ca.DM(self.cylinder.rotation[:, 2]))

    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:
        """Positive between the ends, where x is defined."""
        end = self.cylinder.length / 2 - ca.fabs(self.cylinder.local(point)[2])
        return ca.fmin(self.away_from_pole(point, heading), end)
