"""Fields that hold quantities: constants, expressions, lists of constants."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from taskspec.spec import values
from taskspec.spec.kinds import Kind
from taskspec.spec.reading import Reading, kind_of, span_of
from taskspec.text.codes import register
from taskspec.text.data import Items, Real, Text, Whole
from taskspec.text.expression import Expression, ScopeKind
from taskspec.text.expression.tree import Number
from taskspec.text.traps import adjoin
from taskspec.text.units import (
    NUMBER,
    SMALLEST,
    Dimension,
    alternatives,
    describe,
    fitting,
    in_si,
    noun,
)

register({"TS023": "a list of the wrong length"})

_SCALAR: dict[str, Any] = {"type": ["string", "number"]}
"""A quantity in JSON Schema: text with a unit, or a plain number such as 0."""


@dataclass(frozen=True)
class Constant(Kind):
    """A quantity that does not change.

    Attributes:
        dimension: what it measures.
        above: it has to be greater than this (SI units).
        least: it has to be at least this (SI units).
        most: it has to be at most this (SI units).
        words: words that may stand in its place.
    """

    dimension: Dimension
    above: float | None = None
    least: float | None = None
    most: float | None = None
    words: tuple[str, ...] = ()

    def read(self, value: object, reading: Reading) -> float | str:
        """Return SI units, or one of the words."""
        if isinstance(value, Text) and str(value) in self.words:
            return str(value)
        result = values.constant(value, self.dimension, reading)
        if result is None:
            return 0.0
        if self.above is not None and result <= self.above:
            self._report(value, "more than", self.above, reading)
        elif self.above is not None and result < self.above + SMALLEST:
            self._report(value, "at least", self.above + SMALLEST, reading)
        elif self.least is not None and result < self.least:
            self._report(value, "at least", self.least, reading)
        elif self.most is not None and result > self.most:
            self._report(value, "at most", self.most, reading)
        return result

    def _report(self, value: object, relation: str, bound: float, reading: Reading) -> None:
        limit = in_si(bound, self.dimension) if bound else "0"
        reading.error("TS118", f"this has to be {relation} {limit}", span_of(value))

    def json(self) -> dict[str, Any]:
        """Describe the quantity."""
        return _SCALAR | {"description": _description(self.dimension, self.words)}


def _description(dimension: Dimension, words: tuple[str, ...] = ()) -> str:
    units = fitting(dimension)
    text = describe(dimension)
    text = text[0].upper() + text[1:]
    example = f", such as '10 {units[0]}'" if units else ""
    other = f"; or {alternatives(words)}" if words else ""
    return f"{text}{example}{other}"


@dataclass(frozen=True)
class Formula(Kind):
    """An expression; without a dimension it is a condition."""

    dimension: Dimension | None
    scope: ScopeKind

    def read(self, value: object, reading: Reading) -> Expression:
        """Return the checked expression."""
        return values.expression(value, self.dimension, self.scope, reading) or _NOTHING

    def json(self) -> dict[str, Any]:
        """Describe the expression."""
        if self.dimension is None:
            return {"type": ["string", "boolean"], "description": "A condition"}
        return _SCALAR | {"description": f"{_description(self.dimension)}; an expression"}


_NOTHING = Expression("", Number(0.0, NUMBER), NUMBER)


@dataclass(frozen=True)
class Entries(Kind):
    """A list of constants, each with its own dimension.

    Attributes:
        dimensions: of the entries, in order.
        fewest: how many there have to be; by default all.
        nonzero: they may not all be zero.
        above: each has to be greater than this (SI units).
    """

    dimensions: tuple[Dimension, ...]
    fewest: int | None = None
    nonzero: bool = False
    above: float | None = None

    def read(self, value: object, reading: Reading) -> tuple[float, ...]:
        """Return the entries in SI units."""
        if not isinstance(value, Items):
            message = f"a list of {self._count()} is needed here, this is {kind_of(value)}"
            reading.error("TS022", message, span_of(value), self._example())
            return (0.0,) * len(self.dimensions)
        fewest = len(self.dimensions) if self.fewest is None else self.fewest
        if not fewest <= len(value) <= len(self.dimensions) and not value.node.broken:
            message = f"{self._count()} entries are needed here, these are {len(value)}"
            items = value.node.items
            torn = any(adjoin(a, b) for a, b in pairwise(items)) and len(value) > fewest
            hint = "a comma begins a new entry; decimals follow a point, as in 0.5"
            hint = hint if torn else self._example()
            reading.error("TS023", message, span_of(value), hint)
        before = len(reading.diagnostics)
        result = []
        for entry, dimension in zip(value, self.dimensions, strict=False):
            number = Constant(dimension, above=self.above).read(entry, reading)
            assert isinstance(number, float)
            result.append(number)
        sound = value and len(reading.diagnostics) == before
        if self.nonzero and sound and max(map(abs, result)) < SMALLEST:
            reading.error("TS118", "a direction of length zero", span_of(value))
        return tuple(result)

    def _example(self) -> str:
        """A list of the least length, such as `[10 mm, 0, 0]`."""
        fewest = len(self.dimensions) if self.fewest is None else self.fewest
        units = [next(iter(fitting(d)), "") for d in self.dimensions[:fewest]]
        first = f"10 {units[0]}" if units[0] else "1"
        if self.above is not None:
            return f"such as [{', '.join([first] * fewest)}]"
        return f"such as [{', '.join([first, *['0'] * (fewest - 1)])}]"

    def _count(self) -> str:
        most = len(self.dimensions)
        if self.fewest is None or self.fewest == most:
            return str(most)
        return f"{self.fewest} to {most}"

    def json(self) -> dict[str, Any]:
        """Describe the list."""
        most = len(self.dimensions)
        return {
            "type": "array",
            "minItems": most if self.fewest is None else self.fewest,
            "maxItems": most,
            "prefixItems": [Constant(d).json() for d in self.dimensions],
        }


class Measured(float):
    """A number in SI units that knows what it measures.

    Attributes:
        dimension: of the number; None for a bare 0, which measures anything.
    """

    dimension: Dimension | None

    def __new__(cls, value: float, dimension: Dimension | None = None) -> Measured:
        """Attach the dimension."""
        made = super().__new__(cls, value)
        made.dimension = dimension
        return made


@dataclass(frozen=True)
class Series(Kind):
    """A list of constants, of any length but none.

    Attributes:
        dimension: what an entry measures.
        other: what an entry may measure instead; the entries are then `Measured`.
    """

    dimension: Dimension
    other: Dimension | None = None

    def read(self, value: object, reading: Reading) -> tuple[float, ...]:
        """Return the entries in SI units."""
        if not isinstance(value, Items):
            message = f"a list is needed here, this is {kind_of(value)}"
            reading.error("TS022", message, span_of(value))
            return (0.0,)
        if not value and not value.node.broken:
            reading.error("TS023", "this list is empty", span_of(value))
        if self.other is not None:
            return tuple(self._either(entry, self.other, reading) for entry in value)
        return tuple(values.constant(entry, self.dimension, reading) or 0.0 for entry in value)

    def _either(self, value: object, other: Dimension, reading: Reading) -> Measured:
        needed = f"{noun(self.dimension)} or {noun(other)}"
        if not isinstance(value, Text | Whole | Real):
            message = f"{needed} is needed here, this is {kind_of(value)}"
            reading.error("TS022", message, span_of(value))
            return Measured(0.0)
        found = values.quantity(value, reading)
        if found is None or found.bare:
            return Measured(found.value if found is not None else 0.0)
        if found.dimension == NUMBER:
            units = alternatives((*fitting(self.dimension), *fitting(other)))
            message = f"a number without a unit, where {needed} is needed"
            reading.error("TS110", message, span_of(value), f"add a unit: {units}")
        elif found.dimension not in (self.dimension, other):
            message = f"{needed} is needed here, this is {describe(found.dimension)}"
            reading.error("TS112", message, span_of(value))
        return Measured(found.value, found.dimension)

    def json(self) -> dict[str, Any]:
        """Describe the list."""
        entry = Constant(self.dimension).json()
        if self.other is not None:
            second = _description(self.other)
            entry["description"] += f"; or {second[0].lower()}{second[1:]}"
        return {"type": "array", "minItems": 1, "items": entry}


@dataclass(frozen=True)
class ForJoints(Kind):
    """One constant for all joints, or a list with one for each."""

    dimension: Dimension

    def read(self, value: object, reading: Reading) -> tuple[float, ...]:
        """Return SI units: one number for all joints, or one for each."""
        entries = value if isinstance(value, Items) else [value]
        if not entries:
            reading.error("TS023", "this list is empty", span_of(value))
        one = Constant(self.dimension, least=0)
        return tuple(float(one.read(entry, reading)) for entry in entries)

    def json(self) -> dict[str, Any]:
        """Describe both forms."""
        one = Constant(self.dimension).json()
        return {"anyOf": [one, {"type": "array", "minItems": 1, "items": one}]}
