"""Units of the columns of a log: those of the language, and what sensors and recorders write."""

from __future__ import annotations

import math
import re
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from taskspec.text.units import FORCE, LENGTH, NUMBER, TIME, UNITS, Unit, parse_unit

#: Units that a log may have and a task file may not: a task is written in SI.
_OF_LOGS = {
    "ns": Unit(1e-9, TIME),
    "min": Unit(60.0, TIME),
    "lbf": Unit(4.4482216152605, FORCE),
    "kgf": Unit(9.80665, FORCE),
    "in": Unit(0.0254, LENGTH),
    "ft": Unit(0.3048, LENGTH),
}
#: Spellings of units, and the unit.
_SPELLINGS = {
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "usec": "us",
    "nsec": "ns", "nanosec": "ns", "nanoseconds": "ns", "Lbf": "lbf", "°": "deg", "degrees": "deg",
    "Nmm": "N*mm", "newton": "N", "Newton": "N",
}  # fmt: skip
#: Signs of a product or of a thousandth of a thousandth, and how the language writes them.
_SIGNS = str.maketrans({"·": "*", "⋅": "*", "µ": "u", "μ": "u", "²": "^2"})
_WORD = re.compile(r"[A-Za-z°]+")
_FACTOR = re.compile(r"([*/]?)([A-Za-z]+|%)(?:\^(-?\d))?")


@lru_cache(maxsize=512)
def column_unit(text: str) -> Unit:
    """The unit that a log or a column map names, such as `N`, `lbf*in`, `N-m` or `µs`.

    Raises:
        ValueError: it is not made of known units.
    """
    plain = _WORD.sub(lambda word: _SPELLINGS.get(word[0], word[0]), text.translate(_SIGNS))
    # Data sheets write a product with a hyphen: N-m, lbf-in.
    plain = re.sub(r"(?<=[A-Za-z])-(?=[A-Za-z])", "*", plain.strip())
    try:
        return parse_unit(plain)
    except ValueError:
        known = UNITS | _OF_LOGS
        parts = _FACTOR.findall(plain)
        whole = "".join(f"{o}{n}{'^' if e else ''}{e}" for o, n, e in parts) == plain
        if not whole or not parts or parts[0][0] or any(n not in known for _, n, _ in parts):
            raise
    scale, dimension = 1.0, NUMBER
    for operator, name, exponent in parts:
        power = int(exponent or 1) * (-1 if operator == "/" else 1)
        scale *= known[name].scale ** power
        dimension *= known[name].dimension ** power
    return Unit(scale, dimension)


def known_units() -> str:
    """Every unit by its name, for messages."""
    return " ".join([*UNITS, *_OF_LOGS])


def in_si(values: NDArray[np.float64], unit: str) -> NDArray[np.float64]:
    """Values (n,) of a unit in SI; exact where the unit is a whole part of it, as 1 mm is of 1 m.

    Args:
        values: in the unit.
        unit: empty for plain numbers.
    """
    if not unit:
        return values
    scale = column_unit(unit).scale
    inverse = round(1 / scale) if scale < 1 else 0
    if inverse and math.isclose(inverse * scale, 1.0, rel_tol=1e-15):
        return values / inverse
    return values * scale if scale != 1 else values
