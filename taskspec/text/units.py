"""The closed table of units, dimensions in the user's words, and how a quantity is shown.

A dimension is four exponents, of kg, m, s and rad. Angle is a dimension of its own, so a moment
(N*m) differs from a stiffness against rotation (N*m/rad), and a speed from a rate of turn.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import ClassVar

from taskspec.deferred_methods import dataclass

#: Below this a number is written out, without a power of ten.
_WRITTEN_OUT = 1e7
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

    def on(self, *, rotation: bool) -> Dimension:
        """What it is on an axis: about one, moments and angles for forces and lengths."""
        return _ABOUT.get(self, self) if rotation else self

    @property
    def mixed(self) -> Dimension:
        """What it is between an axis along and one about: N/rad of a stiffness, kg*m of a mass."""
        return self * LENGTH / (NUMBER if self == MASS else ANGLE) if self in _ABOUT else self


@dataclass(frozen=True, slots=True)
class Quantity:
    """A constant: its value in SI units and its dimension.

    A zero that was written without a unit is `bare` and fits every dimension.

    Attributes:
        live: whether it may change while a stage runs; its value is where it begins.
    """

    value: float
    dimension: Dimension
    bare: bool = False

    live: ClassVar[bool] = False


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
LINEAR_ACCELERATION = LENGTH / TIME**2
ANGULAR_ACCELERATION = ANGLE / TIME**2
JERK = LENGTH / TIME**3
ANGULAR_JERK = ANGLE / TIME**3
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
    "mJ": Unit(1e-3, MOMENT),
    "J": Unit(1.0, MOMENT),
    "mW": Unit(1e-3, POWER),
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


@dataclass(frozen=True, slots=True)
class Step:
    """One of the units in which a quantity is read, by its size.

    Attributes:
        unit: as it is shown.
        least: the least size [SI] that is shown in it.
        factor: from SI.
    """

    unit: str
    least: float = 0.0
    factor: float = 1.0


@dataclass(frozen=True, slots=True)
class Measure:
    """A row of the table of units: a kind of quantity, and how people write and read it.

    Attributes:
        noun: what it is, with its article.
        dimension: its exponents; an energy has those of a moment.
        si: its unit in SI; empty for a plain number.
        units: what people write it in; the first is the one that is read most easily.
        sized: units in which text shows it by its size, from coarse to fine; empty where the most
            readable one does for every size.
        page: the same where a page or a chart has its own, finer and shorter units.
    """

    noun: str
    dimension: Dimension
    si: str
    units: tuple[str, ...]
    sized: tuple[Step, ...] = ()
    page: tuple[Step, ...] = ()


_MICRO = 1e6
_MILLI = 1e3
_DEGREES = 180 / math.pi

MEASURES = (
    Measure("a plain number", NUMBER, "", ()),
    Measure("a mass", MASS, "kg", ("kg", "g")),
    Measure(
        "a length", LENGTH, "m", ("mm", "cm", "m"),
        (Step("mm", 0.1e-3), Step("um")),
        (Step("m", 10.0), Step("mm", 0.5e-3, _MILLI), Step("µm", 0.0, _MICRO)),
    ),
    Measure(
        "a time", TIME, "s", ("s", "ms"),
        (Step("s", 1.0), Step("ms")),
        (Step("s", 0.5), Step("ms", 0.0, _MILLI)),
    ),
    Measure(
        "an angle", ANGLE, "rad", ("deg", "rad", "turn"), (),
        (Step("deg", math.radians(0.05), _DEGREES),
         Step("mdeg", math.radians(0.05e-3), _MILLI * _DEGREES),
         Step("µdeg", 0.0, _MICRO * _DEGREES)),
    ),
    Measure("a frequency", FREQUENCY, "Hz", ("Hz", "kHz", "1/s")),
    Measure(
        "a velocity", VELOCITY, "m/s", ("mm/s", "m/s"), (),
        (Step("m/s", 10.0), Step("mm/s", 0.0, _MILLI)),
    ),
    Measure(
        "a rate of turn", ANGULAR_VELOCITY, "rad/s", ("deg/s", "rad/s", "rpm"), (),
        (Step("deg/s", 0.0, _DEGREES),),
    ),
    Measure(
        "a force", FORCE, "N", ("N", "mN", "kN"),
        (Step("N", 0.1), Step("mN")),
        (Step("kN", 1e4, 1e-3), Step("N", 0.05), Step("mN", 0.05e-3, _MILLI),
         Step("µN", 0.0, _MICRO)),
    ),
    Measure(
        "a moment", MOMENT, "N*m", ("N*m", "Nm"),
        (Step("N*m", 0.1), Step("mN*m")),
        (Step("N·m", 0.05), Step("mN·m", 0.05e-3, _MILLI), Step("µN·m", 0.0, _MICRO)),
    ),
    Measure(
        "an energy", MOMENT, "J", ("J", "mJ"), (),
        (Step("J", 0.05), Step("mJ", 0.0, _MILLI)),
    ),
    Measure(
        "a power or a rate of torque", POWER, "W", ("W", "mW", "N*m/s"), (),
        (Step("W", 0.05), Step("mW", 0.0, _MILLI)),
    ),
    Measure("a moment of inertia", INERTIA, "kg*m^2", ("kg*m^2",)),
    Measure(
        "a stiffness", STIFFNESS, "N/m", ("N/m", "N/mm", "kN/m"),
        (Step("kN/m", 1e3), Step("N/m")),
    ),
    Measure("a stiffness against rotation", ANGULAR_STIFFNESS, "N*m/rad",
            ("N*m/rad", "N*m/deg")),
    Measure("a damping", DAMPING, "N*s/m", ("N*s/m",)),
    Measure("a damping against rotation", ANGULAR_DAMPING, "N*m*s/rad", ("N*m*s/rad",)),
    Measure("an area", LENGTH**2, "m^2", ("mm^2", "m^2")),
    Measure("an acceleration", LINEAR_ACCELERATION, "m/s^2", ("m/s^2",)),
    Measure("an angular acceleration", ANGULAR_ACCELERATION, "rad/s^2", ("rad/s^2", "deg/s^2")),
    Measure("a jerk", JERK, "m/s^3", ("m/s^3",)),
    Measure("an angular jerk", ANGULAR_JERK, "rad/s^3", ("rad/s^3", "deg/s^3")),
    Measure("a force per angle", FORCE / ANGLE, "N/rad", ("N/rad", "N/deg")),
    Measure("a force per rate of turn", FORCE / ANGULAR_VELOCITY, "N*s/rad", ("N*s/rad",)),
    Measure("a length per angle", LENGTH / ANGLE, "m/rad", ("mm/rad", "m/rad", "mm/turn")),
    Measure("a mass times a length", MASS * LENGTH, "kg*m", ("kg*m",)),
)  # fmt: skip
"""The one table of units: whatever shows a quantity uses it."""

# Of measures with one dimension the first is meant where nothing but the dimension is known.
_OF_DIMENSION: dict[Dimension, Measure] = {}
for _measure in MEASURES:
    _OF_DIMENSION.setdefault(_measure.dimension, _measure)
_OF_UNIT = {measure.si: measure for measure in MEASURES}
_ABOUT = {
    LENGTH: ANGLE,
    VELOCITY: ANGULAR_VELOCITY,
    LINEAR_ACCELERATION: ANGULAR_ACCELERATION,
    FORCE: MOMENT,
    MASS: INERTIA,
    STIFFNESS: ANGULAR_STIFFNESS,
    DAMPING: ANGULAR_DAMPING,
}
"""Dimensions on a translation, to those of the same on a rotation."""


def measure_of(dimension: Dimension) -> Measure:
    """What is known of quantities of a dimension."""
    if dimension in _OF_DIMENSION:
        return _OF_DIMENSION[dimension]
    symbol = _symbol(dimension)
    return Measure("a quantity", dimension, symbol, (symbol,))


def measure_in(si: str) -> Measure | None:
    """The measure whose SI unit has this name; None where none has."""
    return _OF_UNIT.get(si)


def describe(dimension: Dimension) -> str:
    """The dimension in words, such as `a force (N)`."""
    measure = measure_of(dimension)
    return f"{measure.noun} ({measure.si})" if measure.si else measure.noun


def noun(dimension: Dimension) -> str:
    """The dimension in words without its unit, such as `a force`."""
    return measure_of(dimension).noun if dimension in _OF_DIMENSION else describe(dimension)


def fitting(dimension: Dimension) -> tuple[str, ...]:
    """The units that people use for this dimension, the most readable first."""
    return measure_of(dimension).units


def si_unit(dimension: Dimension) -> str:
    """The SI unit of a dimension, such as `m/s`; empty for plain numbers."""
    return measure_of(dimension).si


def in_si(value: float, dimension: Dimension) -> str:
    """An SI value with its unit, such as `20 Hz`."""
    return f"{value:g} {si_unit(dimension)}".rstrip()


def usual_units() -> tuple[str, ...]:
    """The composed units that people use, such as `mm/s`."""
    return tuple(unit for measure in _OF_DIMENSION.values() for unit in measure.units)


def fitting_text(dimension: Dimension) -> str:
    """The usual units as text, such as `N, mN or kN`."""
    return alternatives(fitting(dimension))


def alternatives(words: tuple[str, ...] | list[str]) -> str:
    """`a`, `a or b`, `a, b or c`."""
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


_SENSE = {
    LENGTH: 1e6,
    TIME: 1e6,
    MASS: 1e6,
    INERTIA: 1e6,
    VELOCITY: 1e6,
    ANGULAR_VELOCITY: 1e6,
    ANGLE: 1e7,
    FORCE: 1e12,
    MOMENT: 1e12,
    STIFFNESS: 1e15,
    ANGULAR_STIFFNESS: 1e15,
    DAMPING: 1e12,
    ANGULAR_DAMPING: 1e12,
    FREQUENCY: 1e12,
}
"""The greatest values of quantities that make sense, far beyond those of any task [SI]: a thousand
kilometres, eleven days, a thousand tonnes."""

_NAMES = "|".join(sorted((re.escape(n) for n in UNITS if n != "%"), key=len, reverse=True))
UNIT_NAME = rf"(?:(?:{_NAMES})(?![A-Za-z0-9_])|%)(?:\^-?[0-9])?"
"""A table name with an optional exponent of one digit, as a regular expression."""
UNIT = rf"(?:1/|/)?{UNIT_NAME}(?:[*/]{UNIT_NAME})*"
"""A whole unit, such as `N*s/m` or `1/s`."""
DIGITS = r"[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?"
"""A number of the expression language."""
QUANTITY = rf"{DIGITS}(?:[ ]*{UNIT})?"
"""A number with or without its unit."""

_ZERO = r"0+(?:\.0+)?(?:[eE][+-]?[0-9]+)?"


def quantity_pattern(*dimensions: Dimension) -> str:
    """A regular expression of texts that may measure one of some dimensions.

    It refuses a lone number with a unit of the table that measures something else, with a word that
    is no unit, or with none; 0 needs none. Expressions, names and other compositions of units pass:
    only the language knows what they measure.

    Args:
        dimensions: what fits; none for whatever the table has.
    """
    any_of_them = not dimensions
    names = [n for n, unit in UNITS.items() if any_of_them or unit.dimension in dimensions]
    plain = any_of_them or NUMBER in dimensions
    fitting_names = "|".join([*names, ""] if plain else names)
    # Where no name fits, (?!(?:)) would refuse nothing.
    wrong = rf"(?!(?:{fitting_names})\s*$)[A-Za-z%]*" if fitting_names else "[A-Za-z%]*"
    composed = [
        re.escape(unit)
        for unit in dict.fromkeys(usual_units())
        if unit not in UNITS and not any_of_them and parse_unit(unit).dimension not in dimensions
    ]
    zero = "" if plain else rf"(?!{_ZERO}\s*$)"
    return rf"^(?!\s*-?\s*{zero}{DIGITS}\s*(?:{'|'.join([wrong, *composed])})\s*$)"


_QUANTITY_PARTS = re.compile(rf"({DIGITS})[ ]*({UNIT})?\Z")
_UNIT_PARTS = re.compile(r"([*/]?)([A-Za-z]+|%)(?:\^(-?[0-9]))?")


@lru_cache(maxsize=512)
def parse_unit(text: str) -> Unit:
    """The unit that `text` names, such as `N*s/m`, `/s` or `1/s`.

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
    """The number and the unit text of a quantity, or None if `text` is not one."""
    match = _QUANTITY_PARTS.match(text)
    if match is None:
        return None
    return float(match[1]), match[2] or ""


def to_si(value: float, unit: str) -> Quantity:
    """A number with the text of its unit (empty for none) in SI units."""
    if not unit:
        return Quantity(value, NUMBER, bare=value == 0)
    parsed = parse_unit(unit)
    # 30 mm is 0.03 rather than 0.030000000000000002 when divided by an exact power of ten.
    inverse = round(1 / parsed.scale) if parsed.scale < 1 else 0
    exact = inverse and math.isclose(inverse * parsed.scale, 1.0, rel_tol=1e-15)
    si = value / inverse if exact else value * parsed.scale
    return Quantity(si, parsed.dimension)


def show(value: float, unit: str | Dimension, digits: int = 4) -> str:
    """An SI value in a unit, or in the most readable one: `show(0.015, LENGTH)` = "15 mm".

    What makes no sense as a quantity of a robot's task is said to be more than what does.
    """
    if isinstance(unit, Dimension):
        unit = next(iter(fitting(unit)), "")
    most = _sense(unit)
    if abs(value) > most:
        beyond = "more than " if value > 0 else "less than -"
        return f"{beyond}{number(most)} {si_unit(parse_unit(unit).dimension)}"
    return f"{number(in_unit(value, unit), digits)} {unit}".rstrip()


def sensible(value: float, dimension: Dimension) -> bool:
    """Whether an SI value is one that something in a robot's task can have."""
    return abs(value) <= _SENSE.get(dimension, math.inf)


@lru_cache(maxsize=512)
def _sense(unit: str) -> float:
    """The greatest value of a unit's dimension that makes sense [SI]."""
    return _SENSE.get(parse_unit(unit).dimension, math.inf) if unit else math.inf


def scaled(value: float, dimension: Dimension, digits: int = 4) -> str:
    """An SI value in the unit that suits its size: `scaled(5e-6, LENGTH)` = "5 um"."""
    return show(value, suited(value, dimension) or dimension, digits)


#: From so much on energies are said in joules [J].
_JOULE = 0.1


def joules(value: float, digits: int = 3) -> str:
    """An energy [J] in words, which has the dimension of a moment: `joules(0.02)` = "20 mJ"."""
    return show(value, "J" if abs(value) >= _JOULE else "mJ", digits)


def grams(value: float, digits: int = 3) -> str:
    """A mass [kg] as people say that of a load: `grams(0.04)` = "40 g"."""
    return show(value, "g" if abs(value) < 1 else "kg", digits)


def suited(size: float, dimension: Dimension) -> str:
    """The unit that suits the size of a quantity [SI]; empty for plain numbers."""
    steps = measure_of(dimension).sized
    suits = (step.unit for step in steps if size == 0 or abs(size) >= step.least)
    return next(suits, next(iter(fitting(dimension)), ""))


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
