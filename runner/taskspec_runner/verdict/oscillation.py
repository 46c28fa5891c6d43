"""Whether a signal oscillates without an end: a narrow band of its spectrum that does not decay.

What is analysed is the last half of a visit of a stage, n ticks, less its straight line. Under a
Hann window w the spectrum X has, by Parseval, in a band of bins the variance

    sum of |X|^2 over the band and its mirror image / (n sum of w^2),

and a sine of amplitude A, whose main lobe is two bins to either side, has there A^2/2.

A half that is longer than MOST_TICKS is analysed twice: its last MOST_TICKS, for what is fast, and
the whole of it in means of k ticks each, for what is slow. White noise of deviation s has s/sqrt(k)
in n/k means, and so the same amplitude in a band as in all n ticks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.spec import Sensor

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Share of a set point, and of a speed that is wanted, from which an amplitude counts.
OF_SET_POINT = 0.05
#: Amplitudes that count at least [N], [N m], [m/s]. A moment is a force on 0.3 m, as elsewhere.
LEAST_FORCE, LEAST_MOMENT, LEAST_SPEED = 1.0, 0.3, 5e-3
#: Share of a joint's torque limit from which an amplitude counts.
OF_TORQUE = 0.02
#: An amplitude of force is not of noise from so many times what noise has in a band of its own.
OF_NOISE = 10.0
#: Ticks of a half visit below which nothing can be decided.
LEAST_TICKS = 64
#: Ticks, or means of ticks, that a spectrum is made of at most.
MOST_TICKS = 1 << 17
#: Cycles that the half visit holds at least; slower is a drift.
LEAST_CYCLES = 4
#: The main lobe of a Hann window, to either side [bins].
LOBE = 2
#: A peak has so many times the power that the median of all bins would give its band.
ABOVE_REST = 20.0
#: To either side the power falls to this share of the peak's before it rises above it again: a step
#: or a kink has a slope for a spectrum, and no peak.
VALLEY = 0.25
#: Beside noise it also has so many times the power of its neighbours, so many bins away.
ABOVE_NEIGHBOURS, NEIGHBOURS = 20.0, (4, 12)
#: Noise of power N in a band of power B makes the growth uncertain by 0.84 sqrt(N/B): a half's
#: amplitude A by 2 s/sqrt(n), N being 10 s^2/n and B being A^2/2. Three times that is granted.
UNCERTAIN = 2.5
#: Bins in which a reference has this share of its own largest amplitude are its affair.
OF_REFERENCE = 0.02
#: Friction makes a square wave of a sine, with 1/m of the amplitude at m times the frequency;
#: so much more than that is let pass.
OF_HARMONICS = 1.5
#: What falls below this share of itself in a quarter of the visit decays.
STAYS = 0.9
#: Envelopes that fall below this share of their mean, more than now and then, are of bursts.
PERSISTS, NOW_AND_THEN = 0.25, 10
#: Median of the power of white noise in a bin, as a share of its mean.
_MEDIAN = np.log(2.0)
#: Lengths of visits whose window is kept: signals of a visit, and worlds of a sweep, share it.
_LENGTHS = 8
#: What a filter cannot know at the ends of the half visit [share].
_ENDS = 1 / 8


def amid_noise(sensor: Sensor, period: float, ticks: int) -> tuple[float, float]:
    """Amplitudes of force [N] and of moment [N m] from which they are not a sensor's noise.

    Noise of deviation s has in a band of 2 LOBE + 1 of n/2 bins the amplitude s sqrt(20/n).

    Args:
        sensor: the true one.
        period: of control [s].
        ticks: that are analysed.
    """
    noise, n = sensor.noise, min(ticks, MOST_TICKS)
    if noise is None or n == 0:
        return 0.0, 0.0
    hold = 1.0 if sensor.rate is None else max(1.0, 1 / (sensor.rate * period))
    share = OF_NOISE * float(np.sqrt(20.0 * hold / n))
    return share * noise.force, share * noise.torque


@dataclass(frozen=True, slots=True)
class Oscillation:
    """What does not decay.

    Attributes:
        frequency: [Hz].
        amplitude: of a sine with the power of the band [unit of the signal].
        growth: factor of its envelope in a quarter of the visit.
    """

    frequency: float
    amplitude: float
    growth: float


class References:
    """What makes the signals of a visit move by intention.

    The spectra are the same for all signals of the visit: they are made once.
    """

    def __init__(self, values: Sequence[Vector]) -> None:
        """The references (n,) each, in whatever unit."""
        self._values = tuple(values)

    @cached_property
    def last(self) -> list[Vector]:
        """Amplitude in each bin of the last ticks, of each reference that moves."""
        most = min(judged(len(self._values[0])), MOST_TICKS) if self._values else 0
        return self.since(most)

    def since(self, ticks: int) -> list[Vector]:
        """The same of so many ticks at the end."""
        return _amplitudes(each[-ticks:] for each in self._values)

    @cached_property
    def means(self) -> list[Vector]:
        """The same of the means of ticks of a half visit that is analysed twice."""
        half = judged(len(self._values[0])) if self._values else 0
        k = -(-half // MOST_TICKS)
        return _amplitudes(_means(each[-half:], k) for each in self._values)


def _amplitudes(references: Iterable[Vector]) -> list[Vector]:
    found = []
    for reference in references:
        # What stands still has no spectrum but that of its rounding.
        if float(np.ptp(reference)) <= _rounding(reference):
            continue
        own = np.sqrt(2.0 * _band(_power(_level(reference))))
        if np.isfinite(own).all() and own.max() > _rounding(reference):
            found.append(own)
    return found


def judged(ticks: int) -> int:
    """How many ticks of a visit are analysed; 0 of one that is too short."""
    half = ticks // 2
    return half if half >= LEAST_TICKS else 0


def oscillation(
    values: Vector,
    period: float,
    least: float,
    references: References | None = None,
    *,
    noisy: bool = False,
) -> Oscillation | None:
    """The largest oscillation in the last half of a visit; None without one, or if it is too short.

    Args:
        values: (n,) of the whole visit.
        period: between two ticks [s].
        least: amplitude from which it counts [unit of the values].
        references: of the visit; None for none.
        noisy: whether noise is among what moves it.
    """
    half = judged(len(values))
    if not half:
        return None
    references = References(()) if references is None else references
    last = values[-min(half, MOST_TICKS) :]
    begun = _begun(last)
    if len(begun) < len(last):
        found = [_of_half(begun, period, least, lambda: references.since(len(begun)), noisy=noisy)]
    else:
        found = [_of_half(last, period, least, lambda: references.last, noisy=noisy)]
    if half > MOST_TICKS:
        k = -(-half // MOST_TICKS)
        slow = _means(values[-half:], k)
        found.append(_of_half(slow, k * period, least, lambda: references.means, noisy=noisy))
    return max(filter(None, found), key=lambda each: each.amplitude, default=None)


def _begun(x: Vector) -> Vector:
    """The signal from where it begins to change; itself where that is within its first part.

    The bounces of a tool that meets its contact late in a stage would grow beside the air before.
    """
    changes = np.flatnonzero(x != x[0])
    begins = int(changes[0]) if len(changes) else 0
    rest = x[begins:] if begins > _ENDS * len(x) else x
    return rest if len(rest) >= LEAST_TICKS else x[:0]


def _means(values: Vector, k: int) -> Vector:
    """(n // k,) means of k ticks each; the first n % k of them (n,) are left out."""
    rows = len(values) // k
    return np.asarray(np.mean(values[len(values) - k * rows :].reshape(rows, k), axis=1))


def _of_half(
    x: Vector, period: float, least: float, intended: Callable[[], list[Vector]], *, noisy: bool
) -> Oscillation | None:
    """The largest oscillation of ticks, or means of ticks, that are analysed as a whole.

    `intended` works out the amplitudes of references in the same bins.
    """
    n = len(x)
    if not n:
        return None
    # A sine of amplitude A spans 2 A, and on the last frequency counts as sqrt(2) A.
    if not np.isfinite(x).all() or float(np.ptp(x)) < np.sqrt(2.0) * least:
        return None
    x = _level(x)
    # No band has more variance than all of the signal under the window.
    if _amplitude_at_most(x) < least:
        return None
    power = _power(x)
    band = _band(power)
    amplitude = np.sqrt(2.0 * band)
    bins = np.arange(len(power))
    free = bins >= LEAST_CYCLES
    wanted = np.full(len(power), least)
    for own in intended():
        free &= own < OF_REFERENCE * own.max()
        first = max(int(np.argmax(own)), 1)
        wanted = np.maximum(wanted, OF_HARMONICS * amplitude[first] * first / np.maximum(bins, 1))
    if not free.any():
        return None
    rest = (2 * LOBE + 1) * float(np.median(power[free])) / _MEDIAN
    free &= (amplitude >= wanted) & (band >= ABOVE_REST * rest)
    around = _neighbours(power) if noisy else np.zeros(len(power))
    free &= band >= ABOVE_NEIGHBOURS * around
    for peak in sorted(np.flatnonzero(free).tolist(), key=lambda k: -amplitude[k]):
        if not _is_peak(band, peak):
            continue
        growth = _growth(x, peak, 2 * LOBE if noisy else max(2 * LOBE, peak // LEAST_CYCLES))
        least_growth = STAYS - UNCERTAIN * float(np.sqrt(around[peak] / band[peak]))
        if growth is not None and growth >= least_growth:
            lobe = slice(max(peak - LOBE, 0), peak + LOBE + 1)
            centre = float(np.average(bins[lobe], weights=power[lobe]))
            return Oscillation(centre / (n * period), float(amplitude[peak]), growth)
    return None


def _is_peak(band: Vector, peak: int) -> bool:
    """Whether there is a valley to either side; beyond the last frequency there need be none."""
    for side in (band[peak:0:-1], band[peak:]):
        low, high = side < VALLEY * side[0], side > side[0]
        if high.any() and not low[: int(np.argmax(high))].any():
            return False
    return bool((band[1 : peak + 1] < VALLEY * band[peak]).any())


def _level(x: Vector) -> Vector:
    """A signal (n,) less its straight line."""
    t, square = _line(len(x))
    level: Vector = x - x.mean() - t * (t @ x) / square
    return level


@lru_cache(maxsize=_LENGTHS)
def _line(n: int) -> tuple[Vector, float]:
    """(n,) from -1 to 1, and the sum of its squares."""
    t = np.linspace(-1.0, 1.0, n)
    return t, float(t @ t)


@lru_cache(maxsize=_LENGTHS)
def _window(n: int) -> tuple[Vector, float]:
    """(n,) Hann's window, and the sum of its squares."""
    w = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(n) / n)
    return w, float(w @ w)


def _amplitude_at_most(x: Vector) -> float:
    """What the amplitude in a band of x (n,) cannot exceed, rounding granted."""
    w, square = _window(len(x))
    windowed = w * x
    return (1.0 + 1e-9) * float(np.sqrt(2.0 * (windowed @ windowed) / square))


def _power(x: Vector) -> Vector:
    """(n // 2 + 1,) variance of x (n,) in each bin, that of the mirror image included."""
    n = len(x)
    w, square = _window(n)
    power = np.abs(np.fft.rfft(w * x)) ** 2 / (n * square)
    power[1 : (n + 1) // 2] *= 2.0
    return np.asarray(power)


def _band(power: Vector) -> Vector:
    """The variance in the main lobe about each bin."""
    return np.convolve(power, np.ones(2 * LOBE + 1), mode="same")


def _neighbours(power: Vector) -> Vector:
    """What a band about each bin would have if it were as its neighbours to either side."""
    near, far = NEIGHBOURS
    kernel = np.ones(2 * far + 1)
    kernel[far - near + 1 : far + near] = 0.0
    count = np.convolve(np.ones(len(power)), kernel, mode="full")[far:-far]
    found = np.convolve(power, kernel, mode="full")[far:-far]
    return np.asarray((2 * LOBE + 1) * found / np.maximum(count, 1.0))


def _growth(x: Vector, peak: int, reach: int) -> float | None:
    """The factor by which the envelope of bins about a peak grows in half of x; None of bursts."""
    n = len(x)
    spectrum = np.fft.fft(x)
    bins = np.arange(n)
    kept = (np.abs(bins - peak) <= reach) & (bins > 0) & (bins <= n // 2)
    envelope = np.abs(np.fft.ifft(np.where(kept, spectrum, 0.0)))
    ends = round(_ENDS * n)
    envelope = envelope[ends : n - ends]
    if np.percentile(envelope, NOW_AND_THEN) < PERSISTS * envelope.mean():
        return None
    middle = len(envelope) // 2
    early, late = (float(np.sqrt(np.mean(e**2))) for e in (envelope[:middle], envelope[middle:]))
    # The middles of the two parts are less than half of x apart.
    return (late / early) ** (n / 2 / middle) if early else None


def _rounding(x: Vector) -> float:
    """Below this a reference stands still."""
    return 1e-9 * max(float(np.max(np.abs(x), initial=0.0)), 1e-6)
