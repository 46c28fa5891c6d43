"""Jerk-limited moves, from a rate to rest.

A move changes its rate from the one that it has to a peak, keeps that, and comes to rest. With a
speed s and a rise time T the jerk is 4 s/T^2 and the acceleration at most 2 s/T. So a change of
rate by D takes the jerk for T/2 sqrt(D/s), and back for as long; beyond D = s the largest
acceleration is held for (D/s - 1) T/2 in between. The peak is s, or the one at which nothing is
left of the distance. So a move is a function of the place and the rate from which it starts, of
numbers and of CasADi's expressions alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.motion.polynomial import PiecewiseCubic

#: A move reaches its speed in this time [s], with a smooth rise of the acceleration.
RISE_TIME = 0.2
#: A length [m or rad] that is no more than what rounding leaves.
_NOWHERE = 1e-12
#: Halvings of the interval of the peak rate, down to the rounding of the speed.
_HALVINGS = 56
#: Pieces of a move: three of its rise, one at its peak, three of its fall, and rest.
PIECES = 8

#: How often a pace is tried so that sections take a time: it is then near by this share, and
#: scaled to be exact, with an acceleration that is near by its square.
_PACE_TRIES, _PACE_TOLERANCE = 30, 1e-3
#: Paces beyond this multiple of the mean one make a time no shorter.
_FASTEST = 100.0

#: A float, or an expression.
Number = Any


def move(
    start: Number, velocity: Number, target: Number, speed: Number, rise: float = RISE_TIME
) -> PiecewiseCubic:
    """A time-optimal move under limits of speed, acceleration 2 speed/rise and jerk 4 speed/rise^2.

    One that starts faster than its speed brakes to it, unless it is nearly there.

    Args:
        start, velocity: initial position and velocity [m, m/s] or [rad, rad/s].
        target: where it comes to rest.
        speed: limit, positive.
        rise: see `RISE_TIME` [s].

    Returns:
        Position against time [s] from the move's start; rests at `target` afterwards. Its
        `PIECES` are expressions where any argument is.

    Raises:
        ValueError: there is no such move (non-finite numbers, zero speed).
    """
    given = (start, velocity, target, speed, rise)
    if any(isinstance(number, ca.SX) for number in given):
        knots, coefficients = _symbolic()(*given)
        return PiecewiseCubic(knots, coefficients)
    if not (all(map(math.isfinite, given)) and speed > 0 and rise > 0):
        raise ValueError(f"no move from {start} to {target} at {speed}")
    times, rows = _pieces(*(float(number) for number in given))
    return PiecewiseCubic(np.array(times), np.array(rows))


def timing(length: Number, *, speed: float | None, time: float | None) -> PiecewiseCubic:
    """The path parameter (0 to 1) against time [s], from rest to rest.

    Args:
        length: of the path [m or rad].
        speed: along it, or time: that it takes; one is given.
    """
    if time is None:
        assert speed is not None
        return move(0.0, 0.0, 1.0, speed / ca.fmax(length, _NOWHERE))
    rise = min(RISE_TIME, time / 2)
    return move(0.0, 0.0, 1.0, 1.0 / (time - rise), rise)


@dataclass(frozen=True, slots=True)
class PathSection:
    """A part of a path whose speed is bounded.

    Attributes:
        length: [m].
        curvature: the greatest on it [1/m].
        speed: that it may not exceed whatever the path's is [m/s].
        rests: the path rests where it begins.
    """

    length: float
    curvature: float = 0.0
    speed: float = math.inf
    rests: bool = False

    def most(self, speed: float, acceleration: float) -> float:
        """The speed on it [m/s] of a path with this speed, and this acceleration across it."""
        across = math.sqrt(acceleration / self.curvature) if self.curvature > 0 else math.inf
        return min(speed, self.speed, across)


def timing_by_sections(
    sections: Sequence[PathSection], *, speed: float | None, time: float | None
) -> PiecewiseCubic:
    """The path parameter (0 to 1) against time [s], from rest to rest, slower where it bends.

    Each section is gone through with one peak; the rate changes as in a move, along the path and
    where neighbours differ within the faster one. Along and across, the acceleration is at most
    2 v/T on its own, and where a path bends there is none along it at the section's own speed.

    Args:
        sections: one after the other.
        speed: the greatest [m/s], or time: that all take [s]; one is given.
    """
    if speed is not None:
        return _by_sections(sections, speed, RISE_TIME)
    assert time is not None
    whole, rise = math.fsum(s.length for s in sections), min(RISE_TIME, time / 2)
    # What is k times as slow, with k times the rise, takes k times as long; k nears 1.
    pace = whole / (time - rise)
    for _ in range(_PACE_TRIES):
        tried = _by_sections(sections, pace, rise)
        share = float(tried.rests) / time
        if abs(share - 1) < _PACE_TOLERANCE:
            break
        pace = min(pace * share, _FASTEST * whole / time)
    rows = tried.coefficients * share ** np.arange(4)
    knots = tried.knots / share
    return PiecewiseCubic(knots, rows)


def _by_sections(sections: Sequence[PathSection], speed: float, rise: float) -> PiecewiseCubic:
    whole = math.fsum(s.length for s in sections)
    # Rates in units of the speed, lengths in units of speed times half a rise.
    unit = speed * rise / 2
    most = [s.most(speed, 2 * speed / rise) / speed for s in sections]
    distances = [s.length / unit for s in sections]
    bounds = [0.0 if s.rests else min(most[i - 1], most[i]) for i, s in enumerate(sections) if i]
    rates = [0.0, *bounds, 0.0]
    for i, distance in enumerate(distances):
        rates[i + 1] = min(rates[i + 1], _reachable(rates[i], distance, rates[i + 1]))
    for i in reversed(range(len(distances))):
        rates[i] = min(rates[i], _reachable(rates[i + 1], distances[i], rates[i]))
    times, rows = [0.0], []
    place, scale = 0.0, unit / whole
    for i, distance in enumerate(distances):
        first, last = rates[i], rates[i + 1]
        peak = _over(first, last, distance, most[i])
        left = max(distance - _distance(first, peak) - _distance(peak, last), 0.0)
        phases = [*_change(first, peak), (left / peak if peak > 0 else 0.0, 0.0)]
        ended = place + distance * scale
        rate, bend = first, 0.0
        for lasts, jerk in (*phases, *_change(peak, last)):
            if lasts <= 0:
                continue
            rows.append([place, scale * rate, scale * bend / 2, scale * jerk / 6])
            place += scale * lasts * (rate + lasts * (bend / 2 + lasts * jerk / 6))
            rate += lasts * (bend + lasts * jerk / 2)
            bend += lasts * jerk
            times.append(times[-1] + lasts)
        place = ended
    rows.append([1.0, 0.0, 0.0, 0.0])
    half = rise / 2
    knots = np.array([*times, times[-1] + 1.0 / half]) * half
    return PiecewiseCubic(knots, np.array(rows) / half ** np.arange(4))


def _change(v: float, w: float) -> list[tuple[float, float]]:
    """How long which jerk lasts in a change of rate."""
    change = w - v
    bent, held, sign = _bent(abs(change)), _straight(abs(change)), math.copysign(1.0, change)
    return [(bent, sign), (held, 0.0), (bent, -sign)]


def _reachable(v: float, distance: float, most: float) -> float:
    """The greatest rate up to `most` at the end of a distance from rate v; at least v."""
    if most <= v or _distance(v, most) <= distance:
        return most
    low, high = v, most
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _distance(v, middle) <= distance else (low, middle)
    return low


def _over(v: float, w: float, distance: float, most: float) -> float:
    """The peak rate of a distance between two rates."""
    low, high = max(v, w), most
    if _distance(v, high) + _distance(high, w) <= distance:
        return high
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        fits = _distance(v, middle) + _distance(middle, w) <= distance
        low, high = (middle, high) if fits else (low, middle)
    return low


@cache
def _symbolic() -> ca.Function:
    """The pieces of a move as a function of what `move` is given."""
    given = [ca.SX.sym(name) for name in ("start", "velocity", "target", "speed", "rise")]
    times, rows = _pieces(*given)
    pieces = ca.vertcat(*(ca.horzcat(*row) for row in rows))
    return ca.Function("move", given, [ca.vertcat(*times), pieces])


def _pieces(
    start: Number, velocity: Number, target: Number, speed: Number, rise: Number
) -> tuple[list[Number], list[list[Number]]]:
    """Knots and coefficients of a move.

    Rates are given in units of its speed, times in halves of its rise.
    """
    half = rise / 2
    v, d = velocity / speed, (target - start) / (speed * half)
    # It goes ahead, or back where even stopping at once leads beyond its target.
    ahead = _where(d >= _distance(v, 0.0), 1.0, -1.0)
    v, d = v * ahead, d * ahead
    reached = d >= _distance(v, 1.0) + _distance(1.0, 0.0)
    peak = 1.0 if reached is True else _where(reached, 1.0, _peak(v, d))
    cruise = _where(
        _either(reached, v > 1.0),
        (d - _distance(v, peak) - _distance(peak, 0.0)) / _positive(peak),
        0.0,
    )
    change = peak - v
    sign = _where(change >= 0, 1.0, -1.0)
    up, held = _bent(_size(change)), _straight(_size(change))
    down, braked = _bent(peak), _straight(peak)
    phases = (
        *((up, sign), (held, 0.0), (up, -sign)),
        (cruise, 0.0),
        *((down, -1.0), (braked, 0.0), (down, 1.0)),
    )
    jerk = ahead * speed / half**2
    t, p, rate, bend = 0.0 * half, start, velocity, 0.0
    times, rows = [t], []
    for lasts, share in phases:
        time, by = half * lasts, jerk * share
        rows.append([p, rate, bend / 2, by / 6])
        p = p + time * (rate + time * (bend / 2 + time * by / 6))
        rate = rate + time * (bend + time * by / 2)
        bend = bend + time * by
        t = t + time
        times.append(t)
    rows.append([target, 0.0, 0.0, 0.0])
    return [*times, t + 1.0], rows


def _peak(v: Number, d: Number) -> Number:
    """The rate at which a move from rate v turns back, its distance d too short for its speed."""
    low = _larger(v, 0.0)
    step = _larger(1.0 - low, 0.0)
    halve = _halving() if _symbol(v) else _halved
    for _ in range(_HALVINGS):
        step = step / 2
        low = halve(v, d, low, step)
    return low


def _halved(v: Number, d: Number, low: Number, step: Number) -> Number:
    """The lower end of where the peak is, once it is known in which half."""
    peak = low + step
    change = peak - v
    up = (v + peak) * (_bent(change) + _straight(change) / 2)
    return low + step * (up + peak * _root(peak) <= d)


@cache
def _halving() -> ca.Function:
    given = [ca.SX.sym(name) for name in ("v", "d", "low", "step")]
    return ca.Function("halved", given, [_halved(*given)])


def _distance(v: Number, w: Number) -> Number:
    """How far a change of rate from v to w leads."""
    change = _size(w - v)
    return (v + w) / 2 * (2 * _bent(change) + _straight(change))


def _bent(change: Number) -> Number:
    """How long the jerk goes on, and back, for a change of rate."""
    return _root(_smaller(change, 1.0))


def _straight(change: Number) -> Number:
    """How long the largest acceleration is held for it."""
    return _larger(change - 1.0, 0.0)


def _symbol(x: Number) -> bool:
    return not isinstance(x, float | bool)


def _where(condition: Number, then: Number, otherwise: Number) -> Number:
    if _symbol(condition):
        return ca.if_else(condition, then, otherwise)
    return then if condition else otherwise


def _either(one: Number, other: Number) -> Number:
    return ca.logic_or(one, other) if _symbol(one) or _symbol(other) else one or other


def _root(x: Number) -> Number:
    return ca.sqrt(x) if _symbol(x) else math.sqrt(x)


def _size(x: Number) -> Number:
    return ca.fabs(x) if _symbol(x) else abs(x)


def _larger(x: Number, y: Number) -> Number:
    return ca.fmax(x, y) if _symbol(x) or _symbol(y) else max(x, y)


def _smaller(x: Number, y: Number) -> Number:
    return ca.fmin(x, y) if _symbol(x) or _symbol(y) else min(x, y)


def _positive(x: Number) -> Number:
    """x, or 1 in the place of 0."""
    return _where(x > 0, x, 1.0)
