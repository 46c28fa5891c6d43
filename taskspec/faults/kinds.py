"""The kinds of fault, one class each, in the order in which they are listed."""

from __future__ import annotations

from abc import abstractmethod
from collections import deque
from typing import TYPE_CHECKING, ClassVar

from taskspec.faults.kind import (
    AMOUNTS,
    CHANGES,
    DEVICES,
    ENCODER,
    OF_DEVICE,
    RATES,
    SENSOR,
    TORQUE,
    FaultKind,
    Shown,
    Sizes,
    anywhere,
    register,
)
from taskspec.text.units import ANGULAR_VELOCITY, NUMBER, TIME, VELOCITY, Quantity

if TYPE_CHECKING:
    import numpy as np

    from taskspec.faults.kind import Vector

#: Ticks by which a time may exceed a whole number of them and still count as it.
_ROUNDING = 1e-6


def _ticks(time: float, period: float) -> int:
    """A time in control periods, at least one, rounded up."""
    return max(1, -int(-(time / period - _ROUNDING) // 1))


class _Held(FaultKind):
    """What passes last before it begins is all that comes."""

    def __init__(
        self, size: Quantity, period: float, every: float, random: np.random.Generator
    ) -> None:
        super().__init__(size, period, every, random)
        self._last: Shown | None = None

    def passes(self, shown: Shown) -> None:
        """Keeps the readings of this tick."""
        self._last = shown.copy()

    def spoil(self, shown: Shown) -> None:
        """The last ones again; of what fails at once, those of now."""
        if self._last is None:
            self._last = shown.copy()
        shown.become(self._last)


@register
class Drops(_Held):
    """Nothing comes, and the controller knows: it goes on with the last value for a while."""

    word, sizes, silent = "drops", {SENSOR: (), ENCODER: ()}, True


@register
class Sticks(_Held):
    """The last value comes again and again, as if nothing changed; an encoder's rate is zero."""

    word, sizes = "sticks", anywhere()

    def spoil(self, shown: Shown) -> None:
        """The last value; a velocity of 0 for an encoder."""
        super().spoil(shown)
        if shown.rates is not None:
            shown.rates[:] = 0.0


@register
class Lost(FaultKind):
    """Zero: a cable is torn, a motor has no current."""

    word, sizes = "lost", anywhere()

    def spoil(self, shown: Shown) -> None:
        """0 in place of each value."""
        for each in shown.vectors:
            each[:] = 0.0


class _Sized(FaultKind):
    """A fault that acts on what its quantity measures: of an encoder on positions or on rates."""

    def spoil(self, shown: Shown) -> None:
        """Changes the one or the other."""
        of_rates = self.dimension in (ANGULAR_VELOCITY, VELOCITY)
        self.change(shown.rates if of_rates and shown.rates is not None else shown.values)

    @abstractmethod
    def change(self, values: Vector) -> None:
        """Changes what is meant in place."""


@register
class Bias(_Sized):
    """A constant is added."""

    word, sizes, examples = "bias", OF_DEVICE, AMOUNTS

    def change(self, values: Vector) -> None:
        """Adds its offset of this tick."""
        values += self.size


@register
class Drifts(FaultKind):
    """What is added grows with time; an encoder that drifts reports the rate, too."""

    word, sizes, examples = "drifts", RATES, CHANGES

    def spoil(self, shown: Shown) -> None:
        """Adds what it has come to."""
        shown.values += self.size * self.period * shown.since
        if shown.rates is not None:
            shown.rates += self.size


@register
class Amplifies(FaultKind):
    """Values are multiplied."""

    word, sizes, examples = "gain", anywhere(NUMBER), dict.fromkeys(DEVICES, "0.8")
    least, most = -100.0, 100.0

    def spoil(self, shown: Shown) -> None:
        """Each value times the factor."""
        for each in shown.vectors:
            each *= self.size


@register
class Flips(FaultKind):
    """Values have the wrong sign."""

    word, sizes = "flips", anywhere()

    def spoil(self, shown: Shown) -> None:
        """Each value with the opposite sign."""
        for each in shown.vectors:
            each *= -1.0


@register
class Swaps(FaultKind):
    """Two channels are exchanged."""

    word, sizes, channels = "swaps", anywhere(), 2

    def spoil(self, shown: Shown) -> None:
        """The values of the two channels, exchanged."""
        for each in shown.vectors:
            each[:] = each[::-1].copy()


@register
class Rustles(_Sized):
    """White noise is added; the quantity is its standard deviation."""

    word, sizes, examples, least = "noise", OF_DEVICE, AMOUNTS, 0.0

    def change(self, values: Vector) -> None:
        """Adds the noise drawn for this tick."""
        values += self.size * self.random.standard_normal(len(values))


@register
class Spikes(_Sized):
    """For one control period, again and again, something is added."""

    word, sizes, examples, recurs = "spikes", OF_DEVICE, AMOUNTS, True

    def change(self, values: Vector) -> None:
        """Adds its offset of this tick."""
        values += self.size

    def spoil(self, shown: Shown) -> None:
        """Changes what is shown where it is time."""
        if shown.since % _ticks(self.every, self.period) == 0:
            super().spoil(shown)


@register
class Late(FaultKind):
    """Values come later than they should."""

    word, sizes, examples = "late", anywhere(TIME), dict.fromkeys(DEVICES, "5 ms")
    least, most, watches = 1e-6, 1.0, True

    def __init__(
        self, size: Quantity, period: float, every: float, random: np.random.Generator
    ) -> None:
        super().__init__(size, period, every, random)
        self._line: deque[Shown] = deque(maxlen=1 + _ticks(self.size, period))

    def passes(self, shown: Shown) -> None:
        """Queues the readings until their delay is over."""
        if self._line and self._line[-1].tick == shown.tick:
            self._line.pop()  # a run begins with a look at what there is
        self._line.append(shown.copy())

    def spoil(self, shown: Shown) -> None:
        """The values of one delay ago."""
        shown.become(self._line[0])


@register
class Clips(FaultKind):
    """Values go no further than this to either side."""

    word, examples, least = "clips", AMOUNTS, 0.0
    sizes: ClassVar[Sizes] = {each: OF_DEVICE[each] for each in (SENSOR, TORQUE)}

    def spoil(self, shown: Shown) -> None:
        """Each value, clipped to the bound."""
        shown.values.clip(-self.size, self.size, out=shown.values)
