"""The slot: a plate with a straight cut of parallel walls."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.plate import CutPlate, bank
from taskspec.shapes.surface import CHAMFER, DEPTH, LENGTH_OF, SizeKey, WholeShape

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taskspec.shapes.surface import Vector


@dataclass(frozen=True, eq=False)
class Slot(CutPlate):
    """A plate below z = 0 with a slot along its x.

    Attributes:
        width: between the walls, along y [m].
        depth: [m].
        chamfer: how far its edges are cut, at 45 degrees [m].
        length: between the walls at its ends, along x [m]; None for an endless one.
    """

    width: float
    depth: float
    chamfer: float = 0.0
    length: float | None = None

    name = "slot"
    keys = (
        SizeKey("width", "Width of a slot", extent=", along its y", shown=("20 mm",)),
        DEPTH,
        CHAMFER,
        LENGTH_OF,
    )
    optional = ("chamfer", "length")
    remark = "a slot is a plane with a cut along its x"
    start_over = "beside a slot"

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from plate, chamfer, wall or bottom."""
        wall = bank(self._beyond(x), x[2], self.chamfer)
        return ca.fmin(wall, x[2] + self.depth)

    def whole(self) -> WholeShape:
        """The slot as the plant takes it."""
        return WholeShape("slot", (self.width, self.depth, self.chamfer, self.length or 0.0))

    def beside(self, x: ca.SX) -> ca.SX:
        """Distance [m] of a point beyond the edge of the slot."""
        return self._beyond(x) - self.chamfer

    def _beyond(self, x: ca.SX) -> ca.SX:
        """Distance [m] of a point (3,) beyond the walls, negative between them."""
        beyond = ca.fabs(x[1]) - self.width / 2
        return beyond if self.length is None else ca.fmax(beyond, ca.fabs(x[0]) - self.length / 2)

    def drawn(self, reach: float, thickness: float) -> Sequence[Vector]:
        """The profile, drawn along x; or rings from the plate's edge down to the bottom."""
        half, edge = self.width / 2, self.width / 2 + self.chamfer
        if self.length is not None:
            end = self.length / 2
            inner = [
                (end + self.chamfer, edge, 0.0), (end, half, -self.chamfer),
                (end, half, -self.depth), (end, 0.0, -self.depth),
            ]  # fmt: skip
            return pocket(inner, max(thickness, self.depth + 0.005), reach)
        right = [(edge + reach, 0.0), (edge, 0.0), (half, -self.chamfer), (half, -self.depth)]
        return profile(right, max(thickness, self.depth + 0.005), edge + reach)


def pocket(inner: list[tuple[float, float, float]], low: float, reach: float) -> list[Vector]:
    """Bands of a plate with a cut that ends.

    Args:
        inner: half length, half width and height of rectangles, from the edge down to where they
            close [m].
        low: how far down the plate is drawn [m].
        reach: how far beyond the cut [m].
    """
    x, y, _ = inner[0]
    outer = [(0.0, 0.0, -low), (x + reach, y + reach, -low), (x + reach, y + reach, 0.0)]
    signs = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1), (1, 1)])
    lines = [np.column_stack((signs * (a, b), np.full(5, z))) for a, b, z in (*outer, *inner)]
    return [line for pair in pairwise(lines) for line in pair]


def profile(right: list[tuple[float, float]], thickness: float, reach: float) -> list[Vector]:
    """Bands of a plate whose profile (y, z) is the same along x, from its right half [m]."""
    left = [(-y, z) for y, z in reversed(right)]
    low = [(left[-1][0], -thickness), (right[0][0], -thickness)]
    ring = np.array([*right, *left, *low, right[0]])[::-1]
    back, front = (np.column_stack((np.full(len(ring), s * reach), ring)) for s in (-1.0, 1.0))
    # A fan closes each end: all of the profile is visible from a point at its bottom.
    behind, before = (
        np.tile([line[0, 0], 0.0, -thickness], (len(line), 1)) for line in (back, front)
    )
    return [behind, back, back, front, front, before]
