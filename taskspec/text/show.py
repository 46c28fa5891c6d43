"""Quantities as a person reads them."""

from __future__ import annotations

import math

from taskspec.text.units import Dimension, fitting, measure_of, to_si

#: Below this a number is written out, without a power of ten.
_WRITTEN_OUT = 1e7


def show(value: float, unit: str | Dimension, digits: int = 4) -> str:
    """An SI value in a unit, or in the most readable one: `show(0.015, LENGTH)` = "15 mm"."""
    if isinstance(unit, Dimension):
        unit = next(iter(fitting(unit)), "")
    return f"{number(in_unit(value, unit), digits)} {unit}".rstrip()


def scaled(value: float, dimension: Dimension, digits: int = 4) -> str:
    """An SI value in the unit that suits its size: `scaled(5e-6, LENGTH)` = "5 um"."""
    steps = measure_of(dimension).sized
    suits = (step.unit for step in steps if value == 0 or abs(value) >= step.least)
    return show(value, next(suits, dimension), digits)


def in_unit(value: float, unit: str) -> float:
    """An SI value as a number of some unit."""
    return value / to_si(1.0, unit).value


def number(value: float, digits: int = 4) -> str:
    """A number rounded to some digits, such as `number(3127.4, 3)` = "3130"."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < _WRITTEN_OUT else text


def inside(value: float, upper: bool, digits: int = 3) -> float:
    """A positive bound in some digits, rounded to the side on which it is satisfied."""
    scale = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return (math.floor if upper else math.ceil)(value / scale) * scale
