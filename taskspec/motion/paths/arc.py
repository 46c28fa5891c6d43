"""A circular arc in the frame's xy plane."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.motion.paths.form import Number, PathForm, norm
from taskspec.motion.paths.key import PathKey
from taskspec.text.units import LENGTH


@dataclass(frozen=True, slots=True)
class Arc(PathForm):
    """A circular arc in the frame's xy plane, from where the stage begins.

    Attributes:
        center: x, y in the frame [m].
        turns: about the center; negative ones run clockwise.
    """

    center: tuple[float, ...]
    turns: float

    name = "arc"
    keys = (
        PathKey(
            "center",
            "Center",
            "The point that it goes about, in the frame's coordinates.",
            entries=(LENGTH, LENGTH),
            description="[x, y] in the frame",
            examples=(["60 mm", 0],),
        ),
        PathKey(
            "turns",
            "Turns",
            "Turns about the center; negative ones run clockwise.",
            examples=(1, -0.5),
        ),
    )
    noun = "an arc"
    title = "An arc in the frame's xy plane"
    meaning = "A circular arc in the frame's xy plane."
    examples = ({"center": ["60 mm", 0], "turns": 1},)

    @property
    def own(self) -> tuple[Axis, ...]:
        """x and y: the arc lies in that plane."""
        return Axis.X, Axis.Y

    def moves(self, axis: Axis) -> bool:  # noqa: ARG002
        """True: an arc moves x and y."""
        return True

    def needs(self, axes: Sequence[Axis]) -> tuple[Axis, ...]:  # noqa: ARG002
        """Both coordinates, even where it drives one of them."""
        return Axis.X, Axis.Y

    @property
    def unknown_length(self) -> bool:
        """Its radius is the distance of its center from where it begins."""
        return True

    def curve(
        self,
        s: ca.SX,
        start: Mapping[Axis, Number],
        segments: Mapping[Axis, ca.SX],  # noqa: ARG002
        axis: Axis,
    ) -> Number:
        """x or y [m] of the circle at s."""
        angle = 2 * ca.pi * self.turns * s
        dx, dy = start[Axis.X] - self.center[0], start[Axis.Y] - self.center[1]
        if axis == Axis.X:
            return self.center[0] + ca.cos(angle) * dx - ca.sin(angle) * dy
        return self.center[1] + ca.sin(angle) * dx + ca.cos(angle) * dy

    def length(self, start: Mapping[Axis, Number], axes: Sequence[Axis]) -> Number:  # noqa: ARG002
        """Radius times angle [m]."""
        dx, dy = start[Axis.X] - self.center[0], start[Axis.Y] - self.center[1]
        return norm([dx, dy]) * 2 * math.pi * abs(self.turns)
