"""Hole, slot and groove in common: an endless plate, solid below z = 0, with a cut in it."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.plane import Plane
from taskspec.shapes.surface import Geom, Surface, SurfaceChart, banded, outside

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taskspec.shapes.surface import Vector

#: How far the plate is drawn beyond the cut, and how thick where the cut is not deeper [m].
_DRAWN_BEYOND, _THICKNESS = 0.11, 0.03


@dataclass(frozen=True, eq=False)
class CutPlate(Surface):
    """An endless plate with a cut."""

    flat = True
    convex = False

    @abstractmethod
    def beside(self, x: ca.SX) -> ca.SX:
        """Distance [m] of a point (3,) from the cut, over the plate, negative over the cut."""

    @abstractmethod
    def drawn(self, reach: float, thickness: float) -> Sequence[Vector]:
        """Polylines (n, 3) [m], an even number: a picture spans a band between each two.

        Args:
            reach: how far the plate is drawn beyond the cut [m].
            thickness: of what is drawn [m].
        """

    def chart(self, face: ca.SX | None = None) -> SurfaceChart:  # noqa: ARG002
        """The plate beside the cut."""
        return PlateChart(self)

    def uncut(self) -> Surface:
        """The plate: which wall of the cut a tool will touch is not known before."""
        return Plane(self.origin, self.rotation)

    def geom(self) -> Geom:
        """The geom that contacts are reported of; it touches nothing itself."""
        return Geom("sphere", (1e-3, 0.0, 0.0))

    def visible_geom(self, center: Vector, half: Vector) -> Geom | None:  # noqa: ARG002
        """A piece of the plate about the cut."""
        return banded(self.drawn(_DRAWN_BEYOND, _THICKNESS))


@dataclass(frozen=True, eq=False)
class PlateChart(SurfaceChart):
    """The plate beside its cut."""

    plate: CutPlate

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance [m] from the plate, continued over the cut."""
        return self.plate.local(point)[2]

    def normal(self, point: ca.SX) -> ca.SX:  # noqa: ARG002
        """The z axis of the plate (3,), world."""
        return ca.SX(ca.DM(self.plate.rotation[:, 2]))

    def own_x(self) -> ca.SX:
        """The x axis of the plate (3,), world."""
        return ca.SX(ca.DM(self.plate.rotation[:, 0]))

    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:  # noqa: ARG002
        """Distance [m] from the edge of the cut, positive beside it."""
        return self.plate.beside(self.plate.local(point))


def bank(beyond: ca.SX, z: ca.SX, chamfer: float) -> ca.SX:
    """Signed distance [m] from a wall below a plate, its edge cut at 45 degrees.

    Args:
        beyond: how far the point is beyond the wall, into it [m].
        z: its height over the plate [m].
        chamfer: [m].
    """
    plain = outside(ca.vertcat(-beyond, z))
    if chamfer == 0:
        return plain
    cut = (z + chamfer - beyond) / np.sqrt(2)
    along = (beyond + z + chamfer) / 2
    # From the chamfer's line: the nearest of its points, or of the faces beyond its ends.
    on = ca.fmax(0, ca.fmin(chamfer, along))
    line = ca.sqrt((beyond - on) ** 2 + (z - on + chamfer) ** 2 + 1e-30)
    wall = ca.sqrt(beyond**2 + ca.fmax(0, z + chamfer) ** 2 + 1e-30)
    top = ca.sqrt(z**2 + ca.fmax(0, chamfer - beyond) ** 2 + 1e-30)
    inside = ca.fmax(ca.fmax(-beyond, z), cut)
    return ca.if_else(inside > 0, ca.fmin(ca.fmin(line, wall), top), inside)
