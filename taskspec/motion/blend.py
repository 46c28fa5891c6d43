"""The start of a reference: from rest, or from the one that is handed over.

The shapes are of CasADi's expressions and of plain numbers alike, so that what runs and what is
predicted are one function.
"""

from __future__ import annotations

from typing import TypeVar

from taskspec.deferred import ca

Number = TypeVar("Number", float, "ca.SX")

#: References are blended in over at least this time [s] (docs/language/stages.md).
BLEND_TIME = 0.2
#: A larger offset takes longer, so that blending alone never moves faster than a default move.
_PEAK = 1.875
#: A reference that does not wait catches up in this time [s] with one that does not begin at rest.
#: It goes faster than that meanwhile, by at most 1.875 * BLEND_TIME/2 / CATCH_UP = 19 %.
CATCH_UP = 1.0
#: An offset that a default move covers in this time [s], 0.1 mm or 0.06 deg, is not waited for.
NEGLIGIBLE = 2e-3


def least(x: Number, most: float) -> Number:
    """The lesser of x and `most`; `most` where x is nan."""
    if isinstance(x, float):
        return x if x <= most else most
    found: Number = ca.fmin(x, most)
    return found


def greatest(x: Number, least: float) -> Number:
    """The greater of x and `least`; `least` where x is nan."""
    if isinstance(x, float):
        return x if x >= least else least
    found: Number = ca.fmax(x, least)
    return found


def offset_shape(s: Number) -> Number:
    """Quintic from 1 to 0 on s in [0, 1], with zero slope and curvature at both ends."""
    s = least(s, 1.0)
    return 1 - s**3 * (10 - s * (15 - 6 * s))


def ramp_shape(s: Number) -> Number:
    """From 0 to 1 on s in [0, 1] with zero slope at both ends."""
    s = least(greatest(s, 0.0), 1.0)
    risen: Number = s**2 * (3 - 2 * s)
    return risen


def from_rest(t: Number) -> Number:
    """The time of a reference that starts from rest at t = 0, by whose rate it goes [s].

    T (u^3 - u^4/2) with u = t/T and T = `BLEND_TIME`, whose rate is `ramp_shape(u)`; then t - T/2.
    What goes by it takes the values that it has in time itself, never faster.
    """
    u = least(greatest(t / BLEND_TIME, 0.0), 1.0)
    passed: Number = BLEND_TIME * u**3 * (1 - u / 2) + greatest(t - BLEND_TIME, 0.0)
    return passed


def run_out(t: Number) -> Number:
    """What is left [s] of coming to rest from a rate of 1, which fades as 1 - `ramp_shape`.

    From -T/2 at t = 0 to 0 at T = `BLEND_TIME`, never back.
    """
    u = least(t / BLEND_TIME, 1.0)
    left: Number = BLEND_TIME * (u - u**3 * (1 - u / 2) - 0.5)
    return left


def added(t: Number, offset: Number, slope: Number, time: Number) -> Number:
    """What continues a reference that is handed over, beside the new one [m, rad].

    Args:
        t: since the stage began [s].
        offset: from the new reference to where the old one comes to rest [m, rad].
        slope: of its rate [m/s, rad/s].
        time: in which the offset fades [s].
    """
    total: Number = offset * offset_shape(t / time) + slope * run_out(t)
    return total


def blend_time(offset: Number, speed: float) -> Number:
    """The time [s] to blend an offset in, so that the blending stays below `speed`."""
    time: Number = ca.fmax(BLEND_TIME, _PEAK * ca.fabs(offset) / speed)
    return time
