"""The slot: a plate with a straight cut of parallel walls."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.plate import CutPlate, bank
from taskspec.shapes.surface import CHAMFER, DEPTH, PlateCut, SizeKey

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taskspec.shapes.surface import Vector


@dataclass(frozen=True, eq=False)
class Slot(CutPlate):
    """A plate below z = 0 with a slot along its x, endless along it.

    Attributes:
        width: between the walls, along y [m].
        depth: [m].
        chamfer: how far its edges are cut, at 45 degrees [m].
    """

    width: float
    depth: float
    chamfer: float = 0.0

    name = "slot"
    keys = (
        SizeKey("width", "Width of a slot", extent=", along its y", shown=("20 mm",)),
        DEPTH,
        CHAMFER,
    )
    optional = ("chamfer",)
    remark = "a slot is a plane with a cut along its x"
    start_over = "beside a slot"

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from plate, chamfer, wall or bottom."""
        wall = bank(ca.fabs(x[1]) - self.width / 2, x[2], self.chamfer)
        return ca.fmin(wall, x[2] + self.depth)

    def cut(self) -> PlateCut:
        """The slot."""
        return PlateCut("slot", (self.width, self.depth, self.chamfer))

    def beside(self, x: ca.SX) -> ca.SX:
        """How far beyond its edge."""
        return ca.fabs(x[1]) - self.width / 2 - self.chamfer

    def seen(self, reach: float, thickness: float) -> Sequence[Vector]:
        """The profile, drawn along x."""
        half, edge = self.width / 2, self.width / 2 + self.chamfer
        right = [(edge + reach, 0.0), (edge, 0.0), (half, -self.chamfer), (half, -self.depth)]
        return profile(right, max(thickness, self.depth + 0.005), edge + reach)


def profile(right: list[tuple[float, float]], thickness: float, reach: float) -> list[Vector]:
    """Bands of a plate whose profile (y, z) is the same along x, from its right half [m]."""
    left = [(-y, z) for y, z in reversed(right)]
    low = [(left[-1][0], -thickness), (right[0][0], -thickness)]
    ring = np.array([*right, *left, *low, right[0]])[::-1]
    back, front = (np.column_stack((np.full(len(ring), s * reach), ring)) for s in (-1.0, 1.0))
    # A fan closes each end: all of the profile is seen from a point at its bottom.
    behind, before = (
        np.tile([line[0, 0], 0.0, -thickness], (len(line), 1)) for line in (back, front)
    )
    return [behind, back, back, front, front, before]
