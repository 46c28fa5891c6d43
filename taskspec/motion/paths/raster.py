"""Parallel lines to and fro over a rectangle."""

from __future__ import annotations

import math
from collections.abc import Sequence

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.motion.paths.key import PathKey, WrongPath
from taskspec.motion.paths.laid import LaidPath, Route
from taskspec.motion.paths.polyline import Polyline
from taskspec.text.units import LENGTH, show

#: More lines are a mistake of units.
MOST_LINES = 1000


@dataclass(frozen=True, slots=True)
class Raster(LaidPath):
    """Parallel lines to and fro over a rectangle, from the corner where the stage begins.

    Lines are joined by two quarters of a circle, whose radius is half of their distance: they stay
    inside of the rectangle.

    Attributes:
        size: of the rectangle along x and y; a negative one leads in the opposite direction [m].
        pitch: greatest distance of two lines [m].
        along: the axis of the lines.
    """

    size: tuple[float, ...]
    pitch: float
    along: str = "x"

    name = "raster"
    keys = (
        PathKey(
            "size",
            "Size",
            "Of the rectangle, from the corner where the stage begins; a negative one leads back.",
            entries=(LENGTH, LENGTH),
            description="[x, y]",
            examples=(["80 mm", "40 mm"],),
        ),
        PathKey(
            "pitch",
            "Distance of the lines",
            "Greatest distance of two lines, which share the rectangle evenly.",
            LENGTH,
            above=0.0,
            examples=("8 mm",),
        ),
        PathKey(
            "along",
            "Axis of the lines",
            "The axis that the lines run along; x where it is left out.",
            words=("x", "y"),
            choice="direction",
            default="x",
            optional=True,
        ),
    )
    noun = "a raster"
    title = "Parallel lines to and fro"
    meaning = "Parallel lines to and fro over a rectangle, from the corner where the stage begins."
    examples = ({"size": ["80 mm", "40 mm"], "pitch": "8 mm"},)

    @property
    def own(self) -> tuple[Axis, ...]:
        """x and y."""
        return Axis.X, Axis.Y

    @property
    def _sides(self) -> tuple[float, float]:
        """Along the lines, and across them [m]."""
        x, y = self.size
        return (x, y) if self.along == "x" else (y, x)

    @property
    def lines(self) -> int:
        """How many there are."""
        return math.ceil(abs(self._sides[1]) / self.pitch - 1e-9) + 1

    def unfit(self, axes: Sequence[Axis]) -> WrongPath | None:  # noqa: ARG002
        """Without a rectangle, with lines too short for their turns, or with very many of them."""
        along, across = self._sides
        if along == 0 or across == 0:
            message = "a raster over a rectangle without a width"
            return WrongPath("TS235", "size", message, "for a single line write line: {by: [..]}")
        if abs(across) / self.pitch > MOST_LINES:
            message = f"a raster of more than {MOST_LINES} lines"
            return WrongPath("TS235", "pitch", message, "mind the units of size and pitch")
        step = abs(across) / (self.lines - 1)
        if abs(along) < step:
            message = f"lines of {show(abs(along), LENGTH)} are shorter than their distance"
            hint = (
                f"a pitch of at most {show(abs(along), LENGTH)} fits, or lines along the other axis"
            )
            return WrongPath("TS235", "pitch", message, hint)
        return None

    def lay(self) -> Route:
        """A polygon with round corners."""
        along, across = self._sides
        step = across / (self.lines - 1)
        points = []
        for i in range(self.lines):
            ends = (0.0, along) if i % 2 == 0 else (along, 0.0)
            points += [(end, i * step) for end in ends]
        if self.along == "y":
            points = [(y, x) for x, y in points]
        line = Polyline(points, abs(step) / 2)
        x, y = line.splines()
        return Route({Axis.X: x, Axis.Y: y}, line.sections())

    def of_axis(self, axis: Axis) -> str:
        """To and fro, or across."""
        if axis == self.along:
            return f"raster of {self.lines} lines"
        return f"raster over {show(abs(self._sides[1]), LENGTH)}"
