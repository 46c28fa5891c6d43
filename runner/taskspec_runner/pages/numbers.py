"""Numbers as a robot engineer reads them: mm and deg instead of m and rad."""

from __future__ import annotations

import math

from taskspec.text.units import ANGLE, LENGTH, NUMBER, Dimension, Measure, measure_in, measure_of

#: Less than this in the finest unit is rounding, of the sum or of the simulation.
NOTHING = 1e-3


def scale(unit: str | Dimension, size: float) -> tuple[float, str]:
    """Factor and shown unit for a quantity of a size [SI], such as (1e6, "µm")."""
    measure = _measure(unit)
    for step in measure.page:
        if abs(size) >= step.least:
            return step.factor, step.unit
    return 1.0, measure.si


def plain_scale(unit: str | Dimension, size: float) -> tuple[float, str]:
    """The same for places, which stay in mm and deg however small they are."""
    measure = _measure(unit)
    if measure.dimension in (LENGTH, ANGLE):
        return next((s.factor, s.unit) for s in measure.page if s.unit == measure.units[0])
    return scale(unit, size)


def _measure(unit: str | Dimension) -> Measure:
    """The row of the table for a dimension, or for an SI unit as the log has it."""
    if isinstance(unit, Dimension):
        return measure_of(unit)
    return measure_in(unit) or Measure("a quantity", NUMBER, unit, ())


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


def quantity(value: float | None, unit: str | Dimension, digits: int = 3) -> tuple[str, str]:
    """A value [SI] as figure and unit in the scale that suits it."""
    if value is None:
        return "–", ""
    factor, shown = scale(unit, value)
    if abs(value * factor) < NOTHING:
        return "0", ""
    return figure(value * factor, digits), shown
