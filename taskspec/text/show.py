"""Quantities as a person reads them."""

from __future__ import annotations

import math

from taskspec.text.units import to_si

#: Below this a number is written out, without a power of ten.
_WRITTEN_OUT = 1e7


def show(value: float, unit: str, digits: int = 4) -> str:
    """An SI value written in `unit`, such as `show(0.015, "mm")` = "15 mm"."""
    return f"{number(value / to_si(1.0, unit).value, digits)} {unit}"


def number(value: float, digits: int = 4) -> str:
    """A number rounded to some digits, such as `number(3127.4, 3)` = "3130"."""
    text = f"{value:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < _WRITTEN_OUT else text


def inside(value: float, upper: bool, digits: int = 3) -> float:
    """A positive bound in some digits, rounded to the side on which it is kept."""
    scale = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return (math.floor if upper else math.ceil)(value / scale) * scale
