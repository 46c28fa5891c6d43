"""Jerk-limited moves, from a rate to rest.

A move changes its rate from the one that it has to a peak, keeps that, and comes to rest. With a
speed s and a rise time T the jerk is 4 s/T^2 and the acceleration at most 2 s/T. So a change of
rate by D takes the jerk for T/2 sqrt(D/s), and back for as long; beyond D = s the largest
acceleration is held for (D/s - 1) T/2 in between. The peak is s, or the one at which nothing is
left of the way. So a move is a function of the place and the rate from which it starts, of numbers
and of CasADi's expressions alike.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from taskspec.deferred import ca, np
from taskspec.motion.polynomial import PiecewiseCubic

#: A move reaches its speed in this time [s], with a smooth rise of the acceleration.
RISE_TIME = 0.2
#: A length [m or rad] that is no more than what rounding leaves.
_NOWHERE = 1e-12
#: Halvings of the interval of the peak rate, down to the rounding of the speed.
_HALVINGS = 56
#: Pieces of a move: three of its rise, one at its peak, three of its fall, and rest.
PIECES = 8

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

    Rates are told in units of its speed, times in halves of its rise.
    """
    half = rise / 2
    v, d = velocity / speed, (target - start) / (speed * half)
    # It goes ahead, or back where even stopping at once leads beyond its target.
    ahead = _where(d >= _way(v, 0.0), 1.0, -1.0)
    v, d = v * ahead, d * ahead
    reached = d >= _way(v, 1.0) + _way(1.0, 0.0)
    peak = 1.0 if reached is True else _where(reached, 1.0, _peak(v, d))
    cruise = _where(
        _either(reached, v > 1.0), (d - _way(v, peak) - _way(peak, 0.0)) / _positive(peak), 0.0
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
    """The rate at which a move from rate v over a way d, too short for its speed, turns back."""
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


def _way(v: Number, w: Number) -> Number:
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
