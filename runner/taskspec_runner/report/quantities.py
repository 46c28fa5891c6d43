"""Quantities as a robot engineer reads them: mm and deg instead of m and rad."""

from __future__ import annotations

import math

#: SI unit to (factor, shown unit, smallest size shown in it), from coarse to fine.
_SCALES: dict[str, tuple[tuple[float, str, float], ...]] = {
    "m": ((1.0, "m", 10.0), (1e3, "mm", 0.5e-3), (1e6, "µm", 0.0)),
    "rad": ((180 / math.pi, "deg", math.radians(5)), (1e3, "mrad", 0.5e-3), (1e6, "µrad", 0.0)),
    "m/s": ((1.0, "m/s", 10.0), (1e3, "mm/s", 0.0)),
    "rad/s": ((180 / math.pi, "deg/s", 0.0),),
    "N": ((1e-3, "kN", 1e4), (1.0, "N", 0.05), (1e3, "mN", 0.05e-3), (1e6, "µN", 0.0)),
    "N*m": ((1.0, "N·m", 0.05), (1e3, "mN·m", 0.05e-3), (1e6, "µN·m", 0.0)),
    "s": ((1.0, "s", 0.5), (1e3, "ms", 0.0)),
    "J": ((1.0, "J", 0.05), (1e3, "mJ", 0.0)),
    "W": ((1.0, "W", 0.05), (1e3, "mW", 0.0)),
}
#: Less than this in the finest unit is rounding, of the sum or of the simulation.
NOTHING = 1e-3
_PLAIN = {"rad": (180 / math.pi, "deg"), "m": (1e3, "mm")}


def scale(unit: str, size: float) -> tuple[float, str]:
    """Factor and shown unit for a quantity of a size [SI], such as (1e6, "µm")."""
    for factor, shown, smallest in _SCALES.get(unit, ()):
        if abs(size) >= smallest:
            return factor, shown
    return 1.0, unit


def plain_scale(unit: str, size: float) -> tuple[float, str]:
    """The same for places, which stay in mm and deg however small they are."""
    return _PLAIN.get(unit) or scale(unit, size)


def figure(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, a real minus sign, no exponent if it can be."""
    if not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    # Rounded first: 9.9996 has the size of 10.
    size = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    text = f"{value:.2e}" if not -4 <= size < 7 else f"{value:.{max(digits - 1 - size, 0)}f}"
    return text.replace("-", "−")


def quantity(value: float | None, unit: str, digits: int = 3) -> tuple[str, str]:
    """A value [SI] as figure and unit in the scale that suits it."""
    if value is None:
        return "–", ""
    factor, shown = scale(unit, value)
    if abs(value * factor) < NOTHING:
        return "0", ""
    return figure(value * factor, digits), shown
