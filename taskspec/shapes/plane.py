"""The plane: endless, solid below its z = 0."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.shapes.surface import Geom, Surface, SurfaceChart

if TYPE_CHECKING:
    from taskspec.shapes.surface import Vector

#: Half thickness [m] of the slab that is drawn of a plane.
_SLAB = 0.015
#: MuJoCo has no moving planes: half edges and half thickness [m] of the block that stands for one.
_BLOCK, _BLOCK_THICKNESS = 1000.0, 10.0


@dataclass(frozen=True, eq=False)
class Plane(Surface):
    """z = 0, with the outward normal z."""

    name = "plane"
    remark = "a plane is solid below its z = 0"
    flat = True
    level = True

    def height(self, x: ca.SX) -> ca.SX:
        """z of the point."""
        return x[2]

    def chart(self, face: ca.SX | None = None) -> SurfaceChart:  # noqa: ARG002
        """All of the plane."""
        return PlaneChart(self)

    def geom(self) -> Geom:
        """A plane of MuJoCo, which has no end."""
        return Geom("plane", (0.0, 0.0, 0.1))

    def moving_geom(self) -> Geom:
        """A block below the plane."""
        return Geom("box", (_BLOCK, _BLOCK, _BLOCK_THICKNESS), (0.0, 0.0, -_BLOCK_THICKNESS))

    def visible_geom(self, center: Vector, half: Vector) -> Geom | None:
        """A slab of the plane."""
        middle = (float(center[0]), float(center[1]), -_SLAB)
        return Geom("box", (float(half[0]), float(half[1]), _SLAB), middle)


@dataclass(frozen=True, eq=False)
class PlaneChart(SurfaceChart):
    """All of a plane."""

    plane: Plane

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance [m] from the plane."""
        return self.plane.distance(point)

    def normal(self, point: ca.SX) -> ca.SX:  # noqa: ARG002
        """z of the plane."""
        return ca.SX(ca.DM(self.plane.rotation[:, 2]))

    def own_x(self) -> ca.SX:
        """x of the plane."""
        return ca.SX(ca.DM(self.plane.rotation[:, 0]))

    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:  # noqa: ARG002
        """Positive everywhere."""
        return ca.SX(1)
