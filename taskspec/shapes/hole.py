"""The hole: a plate with a round bore."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.plate import CutPlate, bank
from taskspec.shapes.surface import CHAMFER, DEPTH, RADIUS, PlateCut, radius_about_z

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taskspec.shapes.surface import Vector

#: Corners of a circle in a picture.
_ROUND = 64


@dataclass(frozen=True, eq=False)
class Hole(CutPlate):
    """A plate below z = 0 with a blind bore along its z.

    Attributes:
        radius: of the bore [m].
        depth: of the bore [m].
        chamfer: how far its edge is cut, at 45 degrees [m].
    """

    radius: float
    depth: float
    chamfer: float = 0.0

    name = "hole"
    keys = (RADIUS, DEPTH, CHAMFER)
    optional = ("chamfer",)
    remark = "a hole is a plane with a bore along its z"
    start_over = "beside the bore of a hole"

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from plate, chamfer, wall or bottom."""
        wall = bank(radius_about_z(x) - self.radius, x[2], self.chamfer)
        return ca.fmin(wall, x[2] + self.depth)

    def cut(self) -> PlateCut:
        """The bore."""
        return PlateCut("hole", (self.radius, self.depth, self.chamfer))

    def beside(self, x: ca.SX) -> ca.SX:
        """How far beyond the bore's edge."""
        return radius_about_z(x) - self.radius - self.chamfer

    def seen(self, reach: float, thickness: float) -> Sequence[Vector]:
        """Rings from the plate's square edge down to the bore's bottom."""
        edge = self.radius + self.chamfer
        angle = -2 * np.pi * np.arange(_ROUND + 1) / _ROUND
        way = np.column_stack((np.cos(angle), np.sin(angle)))
        square = (edge + reach) * way / np.abs(way).max(axis=1, keepdims=True)
        low = -max(thickness, self.depth + 0.005)
        rings = [
            (square, low), (square, 0.0), (edge * way, 0.0), (self.radius * way, -self.chamfer),
            (self.radius * way, -self.depth), (0 * way, -self.depth),
        ]  # fmt: skip
        lines = [np.column_stack((ring, np.full(len(ring), z))) for ring, z in rings]
        under = np.column_stack((0 * way, np.full(len(way), low)))
        lines = [under, *lines]
        return [line for pair in pairwise(lines) for line in pair]
