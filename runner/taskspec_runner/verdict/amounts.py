"""Amounts in the units of an expectation, with as many digits as it takes to see why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taskspec.text.units import to_si
from taskspec_runner.verdict.series import Series

DIGITS = 4
_LONG = 10_000


def handy(unit: str, usual: Sequence[str], bounds: Sequence[Series]) -> str:
    """A coarser unit where bounds have more than four digits before the point, as of 5 mN at 20 N.

    Args:
        unit: that of a part of the bounds. usual: those of their dimension. bounds: themselves.
    """
    size = max((float(np.nanmax(np.abs(b.values), initial=0.0)) for b in bounds), default=0.0)
    fits = (u for u in usual if 1 <= abs(in_unit(size, u)) < _LONG)
    return unit if abs(in_unit(size, unit)) < _LONG else next(fits, unit)


def in_unit(value: float, unit: str) -> float:
    """An SI value in a unit."""
    return value / to_si(1.0, unit).value


def shown(value: float, unit: str, digits: int = DIGITS) -> str:
    """An SI value written in a unit."""
    # Twice: rounded first, then written without an exponent where that is readable.
    return f"{float(f'{in_unit(value, unit):.{digits}g}'):.12g} {unit}".rstrip()


def digits_of(value: float, bounds: Sequence[float], unit: str) -> int:
    """How many digits tell a value from bounds that it is not equal to."""
    for digits in (DIGITS, 6, 9):
        own = shown(value, unit, digits)
        if not any(b != value and shown(b, unit, digits) == own for b in bounds):
            return digits
    return 12
