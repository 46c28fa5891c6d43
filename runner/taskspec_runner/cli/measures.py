"""Numbers for people: SI values in units of a handy size."""

from __future__ import annotations

from collections.abc import Sequence

from taskspec.geometry.axis import Axis
from taskspec.laws.law import gain_named
from taskspec.text.show import show
from taskspec.text.units import to_si


def scaled(value: float, units: Sequence[str], digits: int = 4, least: float = 1.0) -> str:
    """A value [SI] in the first of the units in which it is at least `least`, else in the last."""
    if not units:
        return f"{value:.{digits}g}"
    fits = (u for u in units if value == 0 or abs(value) >= least * to_si(1.0, u).value)
    return show(value, next(fits, units[-1]), digits)


def gain_text(name: str, angular: bool, value: float) -> str:
    """A gain with its unit on a translation, or on a rotation or a joint."""
    return scaled(value, gain_named(name).units(angular=angular))


def length(value: float, axis: Axis) -> str:
    """A distance [m] along an axis, or an angle [rad] about it."""
    return show(value, "deg" if axis.is_rotation else "mm")


def speed(value: float, axis: Axis) -> str:
    """A speed [m/s] along an axis, or [rad/s] about it."""
    return show(value, "deg/s" if axis.is_rotation else "mm/s")


def stiffness(value: float) -> str:
    """A contact stiffness [N/m]."""
    return scaled(value, ("kN/m", "N/m"))


def small_length(value: float) -> str:
    """A length [m] that may be very small."""
    return scaled(value, ("mm", "um"), 3, least=0.1)


def force(value: float) -> str:
    """A force [N] that may be very small."""
    return scaled(value, ("N", "mN"), 3, least=0.1)


def moment(value: float) -> str:
    """A moment [N m]."""
    return show(value, "N*m", 3)
