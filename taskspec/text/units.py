"""The closed table of units, and dimensions in the user's words.

A dimension is four exponents, of kg, m, s and rad. Angle is a dimension of its own, so a moment
(N*m) differs from a stiffness against rotation (N*m/rad), and a speed from a rate of turn.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache

LARGEST = 1e12
"""The greatest magnitude of a number in SI units, far from where powers of it overflow."""
SMALLEST = 1e-12
"""The least value in SI units of what has to be positive, since it may divide."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """Exponents of kilogram, metre, second and radian."""

    mass: float = 0
    length: float = 0
    time: float = 0
    angle: float = 0

    def __mul__(self, other: Dimension) -> Dimension:
        return Dimension(
            self.mass + other.mass,
            self.length + other.length,
            self.time + other.time,
            self.angle + other.angle,
        )

    def __truediv__(self, other: Dimension) -> Dimension:
        return self * other**-1

    def __pow__(self, exponent: float) -> Dimension:
        return Dimension(
            self.mass * exponent,
            self.length * exponent,
            self.time * exponent,
            self.angle * exponent,
        )

    def __str__(self) -> str:
        return describe(self)


@dataclass(frozen=True, slots=True)
class Quantity:
    """A constant: its value in SI units and its dimension.

    A zero that was written without a unit is `bare` and fits every dimension.
    """

    value: float
    dimension: Dimension
    bare: bool = False


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: its size in SI units and its dimension."""

    scale: float
    dimension: Dimension


NUMBER = Dimension()
MASS = Dimension(mass=1)
LENGTH = Dimension(length=1)
TIME = Dimension(time=1)
ANGLE = Dimension(angle=1)
FREQUENCY = NUMBER / TIME
VELOCITY = LENGTH / TIME
ANGULAR_VELOCITY = ANGLE / TIME
FORCE = MASS * LENGTH / TIME**2
MOMENT = FORCE * LENGTH
POWER = MOMENT / TIME
INERTIA = MASS * LENGTH**2
STIFFNESS = FORCE / LENGTH
ANGULAR_STIFFNESS = MOMENT / ANGLE
DAMPING = FORCE / VELOCITY
ANGULAR_DAMPING = MOMENT / ANGULAR_VELOCITY

UNITS: dict[str, Unit] = {
    "um": Unit(1e-6, LENGTH),
    "mm": Unit(1e-3, LENGTH),
    "cm": Unit(1e-2, LENGTH),
    "m": Unit(1.0, LENGTH),
    "us": Unit(1e-6, TIME),
    "ms": Unit(1e-3, TIME),
    "s": Unit(1.0, TIME),
    "kg": Unit(1.0, MASS),
    "g": Unit(1e-3, MASS),
    "mN": Unit(1e-3, FORCE),
    "N": Unit(1.0, FORCE),
    "kN": Unit(1e3, FORCE),
    "Nm": Unit(1.0, MOMENT),
    "J": Unit(1.0, MOMENT),
    "W": Unit(1.0, POWER),
    "mrad": Unit(1e-3, ANGLE),
    "rad": Unit(1.0, ANGLE),
    "deg": Unit(math.pi / 180, ANGLE),
    "turn": Unit(2 * math.pi, ANGLE),
    "rpm": Unit(2 * math.pi / 60, ANGULAR_VELOCITY),
    "Hz": Unit(1.0, FREQUENCY),
    "kHz": Unit(1e3, FREQUENCY),
    "%": Unit(0.01, NUMBER),
}

_WORDS: dict[Dimension, tuple[str, str, tuple[str, ...]]] = {
    NUMBER: ("a plain number", "", ()),
    MASS: ("a mass", "kg", ("kg", "g")),
    LENGTH: ("a length", "m", ("mm", "cm", "m")),
    TIME: ("a time", "s", ("s", "ms")),
    ANGLE: ("an angle", "rad", ("deg", "rad", "turn")),
    FREQUENCY: ("a frequency", "Hz", ("Hz", "kHz", "1/s")),
    VELOCITY: ("a velocity", "m/s", ("mm/s", "m/s")),
    ANGULAR_VELOCITY: ("a rate of turn", "rad/s", ("deg/s", "rad/s", "rpm")),
    FORCE: ("a force", "N", ("N", "mN", "kN")),
    MOMENT: ("a moment", "N*m", ("N*m", "Nm")),
    POWER: ("a power or a rate of torque", "W", ("W", "N*m/s")),
    INERTIA: ("a moment of inertia", "kg*m^2", ("kg*m^2",)),
    STIFFNESS: ("a stiffness", "N/m", ("N/m", "N/mm", "kN/m")),
    ANGULAR_STIFFNESS: ("a stiffness against rotation", "N*m/rad", ("N*m/rad", "N*m/deg")),
    DAMPING: ("a damping", "N*s/m", ("N*s/m",)),
    ANGULAR_DAMPING: ("a damping against rotation", "N*m*s/rad", ("N*m*s/rad",)),
    LENGTH**2: ("an area", "m^2", ("mm^2", "m^2")),
    LENGTH / TIME**2: ("an acceleration", "m/s^2", ("m/s^2",)),
    ANGLE / TIME**2: ("an angular acceleration", "rad/s^2", ("rad/s^2", "deg/s^2")),
    LENGTH / ANGLE: ("a length per angle", "m/rad", ("mm/rad", "m/rad", "mm/turn")),
}


def describe(dimension: Dimension) -> str:
    """Return the dimension in words, such as `a force (N)`."""
    word, unit, _ = _WORDS.get(dimension, ("a quantity", _symbol(dimension), ()))
    return f"{word} ({unit})" if unit else word


def noun(dimension: Dimension) -> str:
    """Return the dimension in words without its unit, such as `a force`."""
    return _WORDS[dimension][0] if dimension in _WORDS else describe(dimension)


def fitting(dimension: Dimension) -> tuple[str, ...]:
    """Return the units that people use for this dimension, the most usual first."""
    if dimension in _WORDS:
        return _WORDS[dimension][2]
    return (_symbol(dimension),)


def si_unit(dimension: Dimension) -> str:
    """Return the SI unit of a dimension, such as `m/s`; empty for plain numbers."""
    if dimension == NUMBER:
        return ""
    return _WORDS[dimension][1] if dimension in _WORDS else _symbol(dimension)


def in_si(value: float, dimension: Dimension) -> str:
    """Return an SI value with its unit, such as `20 Hz`."""
    return f"{value:g} {si_unit(dimension)}".rstrip()


def usual_units() -> tuple[str, ...]:
    """Return the composed units that people use, such as `mm/s`."""
    return tuple(unit for _, _, units in _WORDS.values() for unit in units)


def fitting_text(dimension: Dimension) -> str:
    """Return the usual units as text, such as `N, mN or kN`."""
    return alternatives(fitting(dimension))


def alternatives(words: tuple[str, ...] | list[str]) -> str:
    """Return `a`, `a or b`, `a, b or c`."""
    if len(words) < 2:
        return "".join(words)
    return f"{', '.join(words[:-1])} or {words[-1]}"


def _symbol(dimension: Dimension) -> str:
    parts = (
        ("kg", dimension.mass),
        ("m", dimension.length),
        ("s", dimension.time),
        ("rad", dimension.angle),
    )
    above = [_power(name, exponent) for name, exponent in parts if exponent > 0]
    below = [_power(name, -exponent) for name, exponent in parts if exponent < 0]
    return "/".join(["*".join(above) or "1", *below])


def _power(name: str, exponent: float) -> str:
    return name if exponent == 1 else f"{name}^{exponent:g}"


_NAMES = "|".join(sorted((re.escape(n) for n in UNITS if n != "%"), key=len, reverse=True))
UNIT_NAME = rf"(?:(?:{_NAMES})(?![A-Za-z0-9_])|%)(?:\^-?[0-9])?"
"""A table name with an optional exponent of one digit, as a regular expression."""
UNIT = rf"(?:1/|/)?{UNIT_NAME}(?:[*/]{UNIT_NAME})*"
"""A whole unit, such as `N*s/m` or `1/s`."""
DIGITS = r"[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?"
"""A number of the expression language."""
QUANTITY = rf"{DIGITS}(?:[ ]*{UNIT})?"
"""A number with or without its unit."""

_QUANTITY_PARTS = re.compile(rf"({DIGITS})[ ]*({UNIT})?\Z")
_UNIT_PARTS = re.compile(r"([*/]?)([A-Za-z]+|%)(?:\^(-?[0-9]))?")


@lru_cache(maxsize=512)
def parse_unit(text: str) -> Unit:
    """Return the unit that `text` names, such as `N*s/m`, `/s` or `1/s`.

    Raises:
        ValueError: it is not made of names of the table.
    """
    if not re.fullmatch(UNIT, text):
        raise ValueError(f"'{text}' is not a unit")
    scale, dimension = 1.0, NUMBER
    for operator, name, exponent in _UNIT_PARTS.findall(text.removeprefix("1")):
        unit = UNITS[name]
        power = int(exponent or 1) * (-1 if operator == "/" else 1)
        # A division keeps 1 mm exactly 0.001 where a power of a factor would round.
        scale = scale * unit.scale**power if power >= 0 else scale / unit.scale**-power
        dimension = dimension * unit.dimension**power
    return Unit(scale, dimension)


def split_quantity(text: str) -> tuple[float, str] | None:
    """Return the number and the unit text of a quantity, or None if `text` is not one."""
    match = _QUANTITY_PARTS.match(text)
    if match is None:
        return None
    return float(match[1]), match[2] or ""


def to_si(value: float, unit: str) -> Quantity:
    """Return a number with the text of its unit (empty for none) in SI units."""
    if not unit:
        return Quantity(value, NUMBER, bare=value == 0)
    parsed = parse_unit(unit)
    # 30 mm is 0.03 rather than 0.030000000000000002 when divided by an exact power of ten.
    inverse = round(1 / parsed.scale) if parsed.scale < 1 else 0
    exact = inverse and math.isclose(inverse * parsed.scale, 1.0, rel_tol=1e-15)
    si = value / inverse if exact else value * parsed.scale
    return Quantity(si, parsed.dimension)
