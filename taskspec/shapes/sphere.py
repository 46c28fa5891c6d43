"""The sphere."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.round_patch import PATCH_KEYS, Bowl, SphereCap, fixed_part, patch
from taskspec.shapes.surface import RADIUS, Geom, Surface, SurfaceChart, ToolEnd, ToolSurface

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from taskspec.shapes.surface import Vector


@dataclass(frozen=True, eq=False)
class Sphere(ToolSurface):
    """A sphere about its origin.

    Attributes:
        radius: [m].
    """

    radius: float

    name = "sphere"
    keys = (RADIUS, *PATCH_KEYS)
    optional = tuple(key.name for key in PATCH_KEYS)
    remark = "a sphere or a cylinder with an arc is a part of one"
    start_over = "outside of a sphere, or below the rim of a bowl"
    resting_points = 1
    tool_keys = {"radius": False}  # noqa: RUF012

    @classmethod
    def placed(cls, origin: Vector, rotation: Vector, sizes: Mapping[str, Any]) -> Surface:
        """A sphere; a cap where there is an arc; from within a bowl, by default half a sphere."""
        return patch(origin, rotation, sizes, cls, SphereCap, Bowl, np.pi)

    @classmethod
    def fixed(cls, data: Mapping[str, Any]) -> str:
        """Of a part alone."""
        return fixed_part(data)

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from the centre less the radius."""
        return ca.norm_2(x) - self.radius

    def chart(self, face: ca.SX | None = None) -> SurfaceChart:  # noqa: ARG002
        """The sphere without its poles."""
        return SphereChart(self)

    def geom(self) -> Geom:
        """A sphere with this radius."""
        return Geom("sphere", (self.radius, 0.0, 0.0))

    @property
    def volume(self) -> float:
        """Volume of the sphere [m^3]."""
        return float(4 / 3 * np.pi * np.prod([self.radius] * 3))

    def inertia(self, mass: float) -> list[float]:
        """Moments (3,) [kg m^2] of a ball."""
        return [0.4 * mass * self.radius**2] * 3

    def contact_points(self) -> tuple[Vector, float]:
        """The sphere itself."""
        return np.zeros((1, 3)), self.radius

    def extremes(self) -> tuple[Vector, float]:
        """The centre, and the radius about it."""
        return np.zeros((1, 3)), self.radius

    @classmethod
    def tool_end(
        cls,
        radius: float,
        size: Sequence[float],  # noqa: ARG003
        thickness: float,  # noqa: ARG003
    ) -> ToolEnd:
        """A ball, which touches in one point."""
        centers = np.array([[0.0, 0.0, -radius]])
        solid = cls(np.zeros(3), np.eye(3), radius)
        return ToolEnd(solid, -radius, radius, -radius, centers, np.array([radius]), flat=False)


@dataclass(frozen=True, eq=False)
class SphereChart(SurfaceChart):
    """All of a sphere but the poles, where x is not defined."""

    sphere: Sphere

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance [m] from the sphere."""
        return self.sphere.distance(point)

    def normal(self, point: ca.SX) -> ca.SX:
        """Unit vector (3,) away from the centre, world."""
        x = self.sphere.local(point)
        n = x / ca.sqrt(ca.sumsqr(x) + 1e-30)
        return ca.DM(self.sphere.rotation) @ n

    def own_x(self) -> ca.SX:
        """The x axis of the sphere (3,), world."""
        return ca.SX(ca.DM(self.sphere.rotation[:, 0]))

    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:
        """Distance from the poles, positive away from them."""
        return self.away_from_pole(point, heading)
