"""The resampling rule: what a log's samples come to at the ticks of a task.

A sample that is nearer to a tick than a hundredth of its period is the value of that tick. Between
samples a number is interpolated linearly, a condition or a stage is that of the last sample.
Nothing is filtered. Two samples that are further apart than a bound are not bridged.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import InputError
from taskspec_runner.record.file_array import blocks, counted, empty
from taskspec_runner.recorded.stamps import Stamps

Vector = NDArray[np.float64]

#: A sample so near to a tick, as a share of the period, is the value of the tick.
NEAR = 0.01
#: Periods between two samples that are bridged where a map states no other bound.
BRIDGED = 10
#: Samples a tick beyond which a time in a wrong unit is more likely than such a log.
_MOST_PER_TICK = 100.0


@dataclass(frozen=True, slots=True)
class Ticks:
    """The ticks of a task over a log.

    Attributes:
        period: of the task [s].
        count: how many there are.
        gap: longest time between two samples that is bridged [s].
    """

    period: float
    count: int
    gap: float

    @property
    def clock(self) -> Vector:
        """(count,) run time of each tick [s]."""
        return np.asanyarray(counted(self.count) * self.period, dtype=np.float64)

    def last(self, times: Vector, part: slice) -> NDArray[np.int64]:
        """(k,) the last sample at or before each of some ticks.

        Args:
            times: (n,) of samples [s]; the first is not after the first tick.
            part: which ticks.
        """
        after = np.searchsorted(times, self._clock(part) + NEAR * self.period, side="right")
        return np.asarray(np.maximum(after - 1, 0))

    def _clock(self, part: slice) -> Vector:
        return np.asarray(np.arange(part.start, part.stop) * self.period, dtype=float)

    def _one_each(self, times: Vector, clock: Vector) -> bool:
        """Whether samples stand one at each tick (k,), and the next one behind them if any."""
        near, count = NEAR * self.period, len(clock)
        if len(times) < count or (len(times) > count and times[count] <= clock[-1] + near):
            return False
        return bool((np.abs(times[:count] - clock) <= near).all())

    def values(
        self,
        times: Vector,
        values: Vector,
        *,
        held: bool,
        scaled: Callable[[Vector], Vector] = lambda part: part,
    ) -> Vector:
        """(count,) values at the ticks; NaN next to a sample that is NaN.

        Args:
            times, values: (n,) samples, times rising [s].
            held: whether a value stays until the next sample.
            scaled: what brings some values into the unit of the result.
        """
        made = empty(self.count, np.float64)
        for part in blocks(self.count):
            clock = self._clock(part)
            if self._one_each(times[part.start : part.stop + 1], clock):
                made[part] = scaled(np.array(values[part]))
                continue
            before = self.last(times, part)
            found = scaled(np.array(values[before]))
            between = np.abs(times[before] - clock) > NEAR * self.period
            if not held and between.any():
                first = before[between]
                second = np.minimum(first + 1, len(times) - 1)
                width = np.maximum(times[second] - times[first], 1e-300)
                share = np.clip((clock[between] - times[first]) / width, 0.0, 1.0)
                low, high = (scaled(np.array(values[rows])) for rows in (first, second))
                found[between] = low + share * (high - low)
            made[part] = found
        return made


def check_rate(stamps: Stamps, period: float, gap: float, rate: float | None, what: str) -> None:
    """Finds out whether the samples of a log make up the ticks of a task.

    Args:
        stamps: of the samples.
        period: of the task [s].
        gap: longest time between two of them that is bridged [s].
        rate: that they are to have [Hz]; None for any.
        what: they are the times of.

    Raises:
        InputError: they are too far apart, far too close, or have another rate.
    """
    times = stamps.times
    steps = np.diff(times)
    if not len(steps):
        raise InputError(f"{what}: there is one sample, of which no course can be judged")
    usual = float(np.median(steps))
    if rate is not None and not 0.9 <= usual * rate <= 1.1:
        raise InputError(
            f"{what}: it has {1 / usual:.4g} samples a second, and the map says {rate:.4g} Hz"
        )
    if usual * _MOST_PER_TICK < period:
        raise InputError(
            f"{what}: it has {1 / usual:.4g} samples a second, where the task has "
            f"{1 / period:.4g} ticks; state the unit of the time"
        )
    wide = np.flatnonzero(steps > gap * (1 + 1e-9))
    if len(wide):
        row = int(wide[0])
        often = f" and {len(wide) - 1} more times" if len(wide) > 1 else ""
        raise InputError(
            f"{what}: there is no sample for {1e3 * steps[row]:.6g} ms from {times[row]:.6g} s "
            f"on, {stamps.place(row)}{often}, and up to {1e3 * gap:.6g} ms are bridged "
            f"({1 / period:.4g} ticks a second, {1 / usual:.4g} samples); state the unit of the "
            f"time, or the bound: gap: {np.ceil(1e3 * float(steps.max()) - 1e-6):.0f} ms"
        )


def filled(values: Vector, ticks: Ticks, what: str, *, sparse: bool = False) -> Vector:
    """Values of one stay in a stage, with short gaps closed as between samples.

    Args:
        values: (n,) NaN where there is none; nothing is closed where there is none at all.
        ticks: for the bound.
        what: they are, and where, for the message.
        sparse: whether there may be none for some time, as there is no reference, or no surface.

    Raises:
        InputError: a gap is longer than what is bridged.
    """
    missing = np.isnan(values)
    if not missing.any() or missing.all():
        return values
    padded = empty(len(values) + 2, np.bool_)
    padded[0] = padded[-1] = False
    padded[1:-1] = missing
    # Where each run of missing values begins, and where it is over.
    changes = np.flatnonzero(padded[1:] != padded[:-1])
    starts, ends = changes[0::2], changes[1::2]
    widest = int(np.max(ends - starts))
    if (widest + 1) * ticks.period > ticks.gap * (1 + 1e-9):
        if sparse:
            return values
        row = int(starts[int(np.argmax(ends - starts))])
        raise InputError(
            f"{what} has no value for {1e3 * widest * ticks.period:.6g} ms, from tick {row} of it "
            f"on, and up to {1e3 * ticks.gap:.6g} ms are bridged"
        )
    made = empty(len(values), np.float64)
    for part in blocks(len(values)):
        # From the last value before them to the first one behind them.
        first, after = part.start, part.stop
        if missing[first]:
            first = max(int(starts[np.searchsorted(starts, first, side="right") - 1]) - 1, 0)
        if missing[after - 1]:
            after = min(int(ends[np.searchsorted(ends, after, side="left")]) + 1, len(values))
        known = first + np.flatnonzero(~missing[first:after])
        made[part] = np.interp(np.arange(part.start, part.stop), known, values[known])
    return made
