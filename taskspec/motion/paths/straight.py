"""Straight paths: to a point, and by a distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.motion.paths.form import COORDINATES, Number, PathForm, coordinates, length_of
from taskspec.motion.paths.key import PathKey
from taskspec.text.units import LENGTH, show

if TYPE_CHECKING:
    from taskspec.deferred import ca


@dataclass(frozen=True, slots=True)
class To(PathForm):
    """Straight from where the stage begins to a point of the frame.

    Attributes:
        to: x, y, z [m], rx, ry, rz [rad], from the left.
    """

    to: tuple[float, ...]

    name = "to"
    keys = (
        PathKey(
            "to",
            "Where to",
            "Straight to this point of the frame, as many coordinates as are wanted.",
            entries=COORDINATES,
            fewest=1,
            description="[x, y, z, rx, ry, rz]",
            examples=(["60 mm", "20 mm"],),
        ),
    )
    bare = True
    noun = "a point"
    title = "Where to"
    meaning = keys[0].meaning
    examples = keys[0].examples
    relative = False

    @property
    def own(self) -> tuple[Axis, ...]:
        """The axes of its coordinates."""
        return tuple(coordinates(self.to))

    def moves(self, axis: Axis) -> bool:
        """By how far, depends on where the stage begins; a coordinate of 0 moves nothing."""
        return coordinates(self.to)[axis] != 0.0

    @property
    def unknown_length(self) -> bool:
        """As long as where it begins makes it."""
        return True

    def curve(
        self,
        s: ca.SX,
        start: Mapping[Axis, Number],
        segments: Mapping[Axis, ca.SX],  # noqa: ARG002
        axis: Axis,
    ) -> Number:
        """On the straight line."""
        return start[axis] + s * (coordinates(self.to)[axis] - start[axis])

    def length(self, start: Mapping[Axis, Number], axes: Sequence[Axis]) -> Number:
        """Of the straight line."""
        target = coordinates(self.to)
        return length_of({a: target[a] - start[a] for a in axes})

    def of_axis(self, axis: Axis) -> str:
        """Where to."""
        return f"to {show(coordinates(self.to)[axis], axis.of(LENGTH))}"


@dataclass(frozen=True, slots=True)
class Line(PathForm):
    """A straight line from where the stage begins.

    Attributes:
        by: x, y, z [m], rx, ry, rz [rad], from the left.
    """

    by: tuple[float, ...]

    name = "line"
    keys = (
        PathKey(
            "by",
            "How far",
            "How far it goes on each axis, as many as are wanted.",
            entries=COORDINATES,
            fewest=1,
            description="[x, y, z, rx, ry, rz], from the left",
            examples=(["60 mm", 0, "5 mm"],),
        ),
    )
    noun = "a line"
    title = "A straight line"
    meaning = "Straight by a distance from where the stage begins."
    examples = ({"by": ["60 mm"]},)

    @property
    def own(self) -> tuple[Axis, ...]:
        """The axes of its distances."""
        return tuple(coordinates(self.by))

    def moves(self, axis: Axis) -> bool:
        """Where its distance is not 0."""
        return coordinates(self.by)[axis] != 0.0

    def curve(
        self,
        s: ca.SX,
        start: Mapping[Axis, Number],
        segments: Mapping[Axis, ca.SX],  # noqa: ARG002
        axis: Axis,
    ) -> Number:
        """On the straight line."""
        return start[axis] + s * coordinates(self.by)[axis]

    def length(self, start: Mapping[Axis, Number], axes: Sequence[Axis]) -> Number:  # noqa: ARG002
        """Of the straight line."""
        distances = coordinates(self.by)
        return length_of({a: distances[a] for a in axes})

    def of_axis(self, axis: Axis) -> str:
        """How far."""
        return f"line of {show(coordinates(self.by)[axis], axis.of(LENGTH))}"
