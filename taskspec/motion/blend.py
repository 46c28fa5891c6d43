"""Bumpless entry: how the handed-over reference passes into a stage's own."""

from __future__ import annotations

from taskspec.deferred import ca

#: References are blended in over at least this time [s] (docs/language.md).
BLEND_TIME = 0.2
#: A larger offset takes longer, so that blending alone never moves faster than a default move.
_PEAK = 1.875


def offset_shape(s: ca.SX) -> ca.SX:
    """Quintic from 1 to 0 on s in [0, 1], with zero slope and curvature at both ends."""
    s = ca.fmin(s, 1)
    return 1 - s**3 * (10 - s * (15 - 6 * s))


def slope_shape(s: ca.SX) -> ca.SX:
    """Quintic with slope 1 at s = 0; value, curvature and everything at s = 1 are zero."""
    s = ca.fmin(s, 1)
    return s - s**3 * (6 - s * (8 - 3 * s))


def ramp_shape(s: ca.SX) -> ca.SX:
    """From 0 to 1 on s in [0, 1] with zero slope at both ends."""
    s = ca.fmin(ca.fmax(s, 0), 1)
    return s**2 * (3 - 2 * s)


def blend_time(offset: float, speed: float) -> float:
    """How long to blend an offset in [s], so that the blending stays below `speed`."""
    return max(BLEND_TIME, _PEAK * abs(offset) / speed)
