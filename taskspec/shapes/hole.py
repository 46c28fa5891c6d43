"""The hole: a plate, or a block, with a round bore."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.box import Box
from taskspec.shapes.plate import CutPlate, bank
from taskspec.shapes.surface import (
    CHAMFER,
    DEPTH,
    RADIUS,
    SIZE,
    Surface,
    WholeShape,
    outside,
    radius_about_z,
)

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
        size: (3,) full edges of the block that is all of the plate there is [m]; None for an
            endless plate.
    """

    radius: float
    depth: float
    chamfer: float = 0.0
    size: Sequence[float] | None = None

    name = "hole"
    keys = (RADIUS, DEPTH, CHAMFER, SIZE)
    optional = ("chamfer", "size")
    remark = "a hole is a plane with a bore along its z"
    start_over = "beside the bore of a hole"

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from plate, chamfer, wall or bottom."""
        wall = bank(radius_about_z(x) - self.radius, x[2], self.chamfer)
        bore = ca.fmin(wall, x[2] + self.depth)
        if self.size is None:
            return bore
        a, b, c = self.size
        beyond = ca.vertcat(
            ca.fabs(x[0]) - a / 2, ca.fabs(x[1]) - b / 2, ca.fabs(x[2] + c / 2) - c / 2
        )
        return ca.fmax(bore, outside(beyond))

    def whole(self) -> WholeShape:
        """The bore, and its block, as the plant takes them."""
        return WholeShape("hole", (self.radius, self.depth, self.chamfer, *(self.size or ())))

    def uncut(self) -> Surface:
        """The plate or the block."""
        if self.size is None:
            return super().uncut()
        return Box(self.origin - self.rotation[:, 2] * (self.size[2] / 2), self.rotation, self.size)

    def beside(self, x: ca.SX) -> ca.SX:
        """Distance [m] of a point beyond the bore's edge, and within the block."""
        beyond = radius_about_z(x) - self.radius - self.chamfer
        if self.size is None:
            return beyond
        a, b, _ = self.size
        within = ca.fmin(a / 2 - ca.fabs(x[0]), b / 2 - ca.fabs(x[1]))
        return ca.fmin(beyond, within)

    def drawn(self, reach: float, thickness: float) -> Sequence[Vector]:
        """Rings from the plate's square edge down to the bore's bottom."""
        edge = self.radius + self.chamfer
        angle = -2 * np.pi * np.arange(_ROUND + 1) / _ROUND
        direction = np.column_stack((np.cos(angle), np.sin(angle)))
        half = np.full(2, edge + reach)
        low = -max(thickness, self.depth + 0.005)
        if self.size is not None:
            half, low = np.array(self.size[:2]) / 2, -self.size[2]
        square = direction / np.abs(direction / half).max(axis=1, keepdims=True)
        rings = [
            (square, low), (square, 0.0), (edge * direction, 0.0), (self.radius * direction,
            -self.chamfer), (self.radius * direction, -self.depth), (0 * direction, -self.depth),
        ]  # fmt: skip
        lines = [np.column_stack((ring, np.full(len(ring), z))) for ring, z in rings]
        under = np.column_stack((0 * direction, np.full(len(direction), low)))
        lines = [under, *lines]
        return [line for pair in pairwise(lines) for line in pair]
