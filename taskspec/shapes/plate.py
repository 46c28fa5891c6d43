"""What a hole, a slot and a groove share: an endless plate, solid below z = 0, with a cut in it."""

from __future__ import annotations

from abc import abstractmethod
from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.plane import Plane
from taskspec.shapes.surface import Geom, Surface, SurfaceChart, outside

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
        """How far [m] a point (3,) is over the plate beside the cut, negative over the cut."""

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
        """What contacts are reported of; it touches nothing itself."""
        return Geom("sphere", (1e-3, 0.0, 0.0))

    def visible_geom(self, center: Vector, half: Vector) -> Geom | None:  # noqa: ARG002
        """A piece of the plate about the cut."""
        corners, faces = self.mesh()
        return Geom("mesh", (1.0, 1.0, 1.0), corners=corners, faces=faces)

    def mesh(self) -> tuple[Vector, Vector]:
        """Corners (n, 3) [m] and triangles (m, 3) of what is drawn."""
        bands = self.drawn(_DRAWN_BEYOND, _THICKNESS)
        corners: list[Vector] = []
        faces: list[tuple[int, int, int]] = []
        for first, second in zip(bands[::2], bands[1::2], strict=True):
            begin, n = sum(map(len, corners)), len(first)
            corners += [first, second]
            for i in range(n - 1):
                a, b, c, d = begin + i, begin + i + 1, begin + n + i, begin + n + i + 1
                faces += [(a, c, b), (b, c, d)]
        return np.vstack(corners), np.array(faces, dtype=np.int32)


@dataclass(frozen=True, eq=False)
class PlateChart(SurfaceChart):
    """The plate beside its cut."""

    plate: CutPlate

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance [m] from the plate, continued over the cut."""
        return self.plate.local(point)[2]

    def normal(self, point: ca.SX) -> ca.SX:  # noqa: ARG002
        """z of the plate."""
        return ca.SX(ca.DM(self.plate.rotation[:, 2]))

    def own_x(self) -> ca.SX:
        """x of the plate."""
        return ca.SX(ca.DM(self.plate.rotation[:, 0]))

    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:  # noqa: ARG002
        """Positive beside the cut."""
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
