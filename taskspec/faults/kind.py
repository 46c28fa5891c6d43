"""A kind of fault: its word, what it may happen to, and what it makes of values that pass."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar, TypeVar

from taskspec.deferred_methods import dataclass
from taskspec.text.units import (
    ANGLE,
    ANGULAR_VELOCITY,
    FORCE,
    LENGTH,
    MOMENT,
    TIME,
    VELOCITY,
    Dimension,
    Quantity,
)

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Vector = NDArray[np.float64]

SENSOR, TORQUE, ENCODER = "sensor", "torque", "encoder"
DEVICES = (SENSOR, TORQUE, ENCODER)
"""What a fault may happen to: the force sensor, the joints' torques, the joints' encoders."""

Sizes = Mapping[str, tuple[Dimension, ...]]

#: What a device measures or exerts; of an encoder also the rate that it reports.
OF_DEVICE: Sizes = {
    SENSOR: (FORCE, MOMENT),
    TORQUE: (MOMENT, FORCE),
    ENCODER: (ANGLE, LENGTH, ANGULAR_VELOCITY, VELOCITY),
}
#: Its change with time.
RATES: Sizes = {
    SENSOR: (FORCE / TIME, MOMENT / TIME),
    TORQUE: (MOMENT / TIME, FORCE / TIME),
    ENCODER: (ANGULAR_VELOCITY, VELOCITY),
}

AMOUNTS = {SENSOR: "3 N", TORQUE: "2 N*m", ENCODER: "1 deg"}
"""Examples of what a device measures."""
CHANGES = {SENSOR: "2 N/s", TORQUE: "2 N*m/s", ENCODER: "1 deg/s"}
"""Examples of its change with time."""


def anywhere(*dimensions: Dimension) -> Sizes:
    """The same sizes for every device."""
    return dict.fromkeys(DEVICES, dimensions)


@dataclass(slots=True)
class Shown:
    """The readings of some channels of a device in a tick.

    Attributes:
        values: (channels,).
        rates: (channels,) of an encoder, beside its positions; None of others.
        tick: number of control periods so far.
        since: number of control periods since the fault began.
    """

    values: Vector
    rates: Vector | None
    tick: int
    since: int = 0

    @property
    def vectors(self) -> tuple[Vector, ...]:
        """All vectors of its state."""
        return (self.values,) if self.rates is None else (self.values, self.rates)

    def copy(self) -> Shown:
        """The same in memory of its own."""
        rates = None if self.rates is None else self.rates.copy()
        return Shown(self.values.copy(), rates, self.tick, self.since)

    def become(self, other: Shown) -> None:
        """Shows in place what another one does."""
        for own, others in zip(self.vectors, other.vectors, strict=True):
            own[:] = others


class FaultKind(ABC):
    """A fault of one kind while a run goes on: it sees the values of its channels every tick.

    Each class says in `word` how it is written, in `sizes` what it may happen to and the dimensions
    of the quantity that follows the word (none where nothing does), in `examples` such a quantity
    of each device, in `least` and `most` its bounds [SI], in `channels` on how many channels it
    acts where that is fixed, in `recurs` whether it comes again and again, in `silent` whether the
    controller notices that nothing comes, and in `watches` whether it sees what passes while it
    acts, too.

    Attributes:
        size: the quantity [SI].
        dimension: of it.
        period: of control [s].
        every: time from one occurrence to the next, of a kind that comes again and again [s].
        random: draws of a fault of its own.
    """

    word: ClassVar[str]
    sizes: ClassVar[Sizes]
    examples: ClassVar[Mapping[str, str]] = {}
    least: ClassVar[float | None] = None
    most: ClassVar[float | None] = None
    channels: ClassVar[int | None] = None
    recurs: ClassVar[bool] = False
    silent: ClassVar[bool] = False
    watches: ClassVar[bool] = False

    def __init__(
        self, size: Quantity, period: float, every: float, random: np.random.Generator
    ) -> None:
        self.size, self.dimension = size.value, size.dimension
        self.period, self.every, self.random = period, every, random

    def passes(self, shown: Shown) -> None:  # noqa: B027
        """Sees what its channels show as they are without it."""

    @abstractmethod
    def spoil(self, shown: Shown) -> None:
        """Changes what its channels show in place."""


KINDS: dict[str, type[FaultKind]] = {}
"""All kinds, by their words."""

_Kind = TypeVar("_Kind", bound=type[FaultKind])


def register(kind: _Kind) -> _Kind:
    """Makes a kind known by its word."""
    KINDS[kind.word] = kind
    return kind


def kinds_of(device: str) -> dict[str, type[FaultKind]]:
    """The kinds that may happen to a device, by their words."""
    return {word: kind for word, kind in KINDS.items() if device in kind.sizes}
