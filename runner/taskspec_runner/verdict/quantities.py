"""Quantities in the units of an expectation, with as many digits as it takes to see why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taskspec.expression.series import Series
from taskspec.text.units import in_unit, show

DIGITS = 4
#: Numbers from here on have too many digits before the point.
_LARGEST_NUMBER = 10_000


def readable_unit(unit: str, usual: Sequence[str], bounds: Sequence[Series]) -> str:
    """A coarser unit where bounds have more than four digits before the point, as of 5 mN at 20 N.

    Args:
        unit: that of a part of the bounds.
        usual: those of their dimension.
        bounds: themselves.
    """
    size = max((float(np.nanmax(np.abs(b.values), initial=0.0)) for b in bounds), default=0.0)
    fits = (u for u in usual if 1 <= abs(in_unit(size, u)) < _LARGEST_NUMBER)
    return unit if abs(in_unit(size, unit)) < _LARGEST_NUMBER else next(fits, unit)


def digits_of(value: float, bounds: Sequence[float], unit: str) -> int:
    """Number of digits that separate a value from bounds that it is not equal to."""
    for digits in (DIGITS, 6, 9):
        own = show(value, unit, digits)
        if not any(b != value and show(b, unit, digits) == own for b in bounds):
            return digits
    return 12
