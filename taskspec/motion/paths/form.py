"""What a path is: its keys in a file, its curve, its length, its timing, its words."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from taskspec.deferred import ca
from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, Axis
from taskspec.motion.profile import timing
from taskspec.text.units import ANGLE, LENGTH

if TYPE_CHECKING:
    from taskspec.motion.paths.key import PathKey, WrongPath
    from taskspec.motion.polynomial import PiecewiseCubic

#: A number, or an expression of what is known when a stage is entered.
Number = Any
#: What [x, y, z, rx, ry, rz] measure.
COORDINATES = (LENGTH, LENGTH, LENGTH, ANGLE, ANGLE, ANGLE)


@dataclass(frozen=True, slots=True)
class PathForm(ABC):
    """A kind of path; a subclass is one, and takes the values of its keys by their names.

    Coordinates are those of the stage's frame. The path parameter s goes from 0 to 1, but where a
    table has its own time.

    Attributes:
        name: its key in a file.
        keys: that its mapping has.
        bare: whether the value of its one key stands in the place of the mapping.
        noun: in messages, with its article.
        title: for editors.
        meaning: what it is, in a sentence that an editor shows.
        examples: values that editors show.
        relative: it counts from where the stage begins.
    """

    name: ClassVar[str]
    keys: ClassVar[tuple[PathKey, ...]] = ()
    bare: ClassVar[bool] = False
    noun: ClassVar[str]
    title: ClassVar[str]
    meaning: ClassVar[str]
    examples: ClassVar[tuple[Any, ...]] = ()
    relative: ClassVar[bool] = True

    # What files may say

    @classmethod
    def wrong(cls, data: Mapping[str, Any]) -> WrongPath | None:  # noqa: ARG003
        """What the keys of a file cannot mean together, by their lengths alone."""
        return None

    def unfit(self, axes: Sequence[Axis]) -> WrongPath | None:  # noqa: ARG002
        """Why the curve cannot be laid; None where it can."""
        return None

    # The axes

    @property
    @abstractmethod
    def own(self) -> tuple[Axis, ...]:
        """The axes that it has coordinates for."""

    @abstractmethod
    def moves(self, axis: Axis) -> bool:
        """Whether it moves one of them."""

    def needs(self, axes: Sequence[Axis]) -> tuple[Axis, ...]:
        """The axes of which its curve needs the coordinate at the stage start.

        Args:
            axes: that it drives.
        """
        return tuple(axes)

    @property
    def unknown_length(self) -> bool:
        """Whether its length depends on where the stage begins."""
        return False

    # The curve

    @abstractmethod
    def curve(
        self, s: ca.SX, start: Mapping[Axis, Number], segments: Mapping[Axis, ca.SX], axis: Axis
    ) -> Number:
        """The coordinate of a driven axis [m, rad].

        Args:
            s: the path parameter.
            start: coordinates of the reference that is handed over, of the axes that it `needs`.
            segments: the current cubic (5,) of each axis of a path that is laid in splines.
            axis: which.
        """

    def place(self, s: float, start: Mapping[Axis, float], axis: Axis) -> float:
        """The same in numbers, as far as predictions need it."""
        return float(self.curve(s, start, {}, axis))

    @property
    def in_splines(self) -> bool:
        """Whether it reaches the tick as `splines`, known when the task is compiled."""
        return False

    def splines(self, axes: Sequence[Axis]) -> dict[Axis, PiecewiseCubic]:  # noqa: ARG002
        """Coordinates against s, of a path that is laid in such."""
        return {}

    # The timing

    @abstractmethod
    def length(self, start: Mapping[Axis, Number], axes: Sequence[Axis]) -> Number:
        """Length [m] over the driven translations; [rad] for a path that only turns.

        Args:
            start: coordinates as the stage starts; numbers, or expressions.
            axes: that it drives.
        """

    def timing(
        self,
        start: Mapping[Axis, Number],
        axes: Sequence[Axis],
        speed: float | None,
        time: float | None,
    ) -> PiecewiseCubic:
        """The path parameter against time [s], from rest to rest.

        Args:
            start: coordinates as the stage starts; numbers, or expressions.
            axes: that it drives.
            speed: greatest along it [m/s], or time: that it takes [s]; one is given.
        """
        return timing(self.length(start, axes), speed=speed, time=time)

    # Words

    def of_axis(self, axis: Axis) -> str:  # noqa: ARG002
        """What an axis does on it, for messages."""
        return self.name


def coordinates(values: Iterable[float]) -> dict[Axis, float]:
    """A list of path coordinates by axis, in the order x, y, z, rx, ry, rz."""
    return dict(zip(AXES, values, strict=False))


def norm(values: Sequence[Number]) -> Number:
    """The Euclidean norm of numbers or expressions."""
    if all(isinstance(value, float | int) for value in values):
        return math.hypot(*values)
    return ca.norm_2(ca.vertcat(*values))


def length_of(ends: Mapping[Axis, Number]) -> Number:
    """Length [m] of a straight line over its translations; [rad] where it only turns."""
    moved = norm([e for a, e in ends.items() if not a.is_rotation] or [0.0])
    turned = norm([e for a, e in ends.items() if a.is_rotation] or [0.0])
    if isinstance(moved, float):
        return moved or turned
    return ca.if_else(moved > 0, moved, turned)
