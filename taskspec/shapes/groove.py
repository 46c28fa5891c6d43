"""The groove: a plate with a straight cut of two flanks."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.plate import CutPlate, bank
from taskspec.shapes.slot import pocket, profile
from taskspec.shapes.surface import DEPTH, LENGTH_OF, SizeKey, WholeShape
from taskspec.text.units import ANGLE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from taskspec.shapes.surface import Vector

#: What is flatter has hardly a side [rad].
_LARGEST_ANGLE = 170 * math.pi / 180


@dataclass(frozen=True, eq=False)
class Groove(CutPlate):
    """A plate below z = 0 with a groove along its x.

    Attributes:
        angle: between its flanks [rad].
        depth: [m].
        length: between the upright walls at its ends, along x [m]; None for an endless one.
    """

    angle: float
    depth: float
    length: float | None = None

    name = "groove"
    keys = (
        SizeKey(
            "angle",
            "Angle between the flanks of a groove",
            dimension=ANGLE,
            description="Between the flanks of a groove",
            example="90 deg",
            shown=("90 deg",),
            most=_LARGEST_ANGLE,
        ),
        DEPTH,
        LENGTH_OF,
    )
    optional = ("length",)
    remark = "a groove is a plane with a cut of two flanks along its x"
    start_over = "beside a groove"

    @property
    def edge(self) -> float:
        """Half its width at the plate [m]."""
        return float(self.depth * np.tan(self.angle / 2))

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from plate, flank or edge."""
        c, s = np.cos(self.angle / 2), np.sin(self.angle / 2)
        beyond = ca.fabs(x[1]) - self.edge
        # Over the flank, and from the edge along it; `top` likewise of the plate.
        flank, down = s * x[2] - c * beyond, -s * beyond - c * x[2]
        line = ca.sqrt(flank**2 + ca.fmax(0, -down) ** 2 + 1e-30)
        top = ca.sqrt(x[2] ** 2 + ca.fmax(0, -beyond) ** 2 + 1e-30)
        inside = ca.fmax(flank, x[2])
        found = ca.if_else(inside > 0, ca.fmin(line, top), inside)
        if self.length is None:
            return found
        return ca.fmin(found, bank(ca.fabs(x[0]) - self.length / 2, x[2], 0.0))

    def whole(self) -> WholeShape:
        """The groove as the plant takes it."""
        return WholeShape("groove", (self.angle, self.depth, self.length or 0.0))

    def beside(self, x: ca.SX) -> ca.SX:
        """Distance [m] of a point beyond the edge of the groove."""
        beyond = ca.fabs(x[1]) - self.edge
        return beyond if self.length is None else ca.fmax(beyond, ca.fabs(x[0]) - self.length / 2)

    def drawn(self, reach: float, thickness: float) -> Sequence[Vector]:
        """The profile, drawn along x; or rings from the plate's edge down to the bottom."""
        if self.length is not None:
            end = self.length / 2
            inner = [(end, self.edge, 0.0), (end, 0.0, -self.depth)]
            return pocket(inner, max(thickness, self.depth + 0.005), reach)
        right = [(self.edge + reach, 0.0), (self.edge, 0.0), (0.0, -self.depth)]
        return profile(right, max(thickness, self.depth + 0.005), self.edge + reach)
