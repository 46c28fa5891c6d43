"""Fields that hold quantities: constants, expressions, lists of constants, intervals."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, Problem, ScopeKind, check
from taskspec.expression.intervals import share_of_zero, share_problems
from taskspec.expression.tree import IntervalNode, Number, SpreadNode, is_share
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, Real, Text, Whole
from taskspec.text.suggest import suggestion
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
    quantity_pattern,
)

register({"TS023": "a list of the wrong length"})


def quantity_schema(*dimensions: Dimension) -> dict[str, Any]:
    """A quantity in JSON Schema: text that may measure one of some dimensions, or a number.

    A number without a unit is 0, unless a plain number is among them. The messages are those of the
    language, for editors that show them.

    Args:
        dimensions: what fits; none for whatever has a unit.
    """
    nouns = alternatives([noun(d) for d in dimensions]) or "a quantity"
    units = alternatives(tuple(unit for d in dimensions for unit in fitting(d)))
    message = f"{nouns} is needed here" + (f", in {units}" if units else "")
    found: dict[str, Any] = {
        "type": ["string", "number"],
        "pattern": quantity_pattern(*dimensions),
        "patternErrorMessage": message,
    }
    if dimensions and NUMBER not in dimensions:
        found["if"] = {"type": "number"}
        found["then"] = {"const": 0, "errorMessage": message}
    return found


@dataclass(frozen=True)
class Constant(FieldType):
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

    def read(self, value: object, context: ParseContext) -> float | str:
        """SI units, or one of the words."""
        if isinstance(value, Text) and str(value) in self.words:
            return str(value)
        if isinstance(value, Text) and self.words and value.isidentifier():
            params = context.scope(ScopeKind.CONSTANT).params
            if value not in params:
                near = suggestion(value, (*params, *self.words))
                hint = near or f"a quantity with its unit, or {alternatives(self.words)}"
                context.error("TS120", f"unknown name {str(value)!r}", span_of(value), hint)
                return 0.0
        result = values.constant(value, self.dimension, context)
        if result is None:
            return 0.0
        if self.above is not None and result <= self.above:
            self._report(value, "more than", self.above, context)
        elif self.above is not None and result < self.above + SMALLEST:
            self._report(value, "at least", self.above + SMALLEST, context)
        elif self.least is not None and result < self.least:
            self._report(value, "at least", self.least, context)
        elif self.most is not None and result > self.most:
            self._report(value, "at most", self.most, context)
        return result

    def _report(self, value: object, relation: str, bound: float, context: ParseContext) -> None:
        limit = in_si(bound, self.dimension) if bound else "0"
        context.error("TS118", f"this has to be {relation} {limit}", span_of(value))

    def json(self) -> dict[str, Any]:
        """Describes the quantity."""
        said = [
            f"; {relation} {in_si(bound, self.dimension) if bound else '0'}"
            for relation, bound in (
                ("more than", self.above), ("at least", self.least), ("at most", self.most),
            )
            if bound is not None
        ]  # fmt: skip
        about = {"description": _description(self.dimension, self.words) + "".join(said)}
        return quantity_schema(self.dimension) | self._bounds() | about

    def _bounds(self) -> dict[str, float]:
        """Of plain numbers; those of others stand beside a unit."""
        if self.dimension != NUMBER:
            return {}
        bounds = {
            "exclusiveMinimum": self.above, "minimum": self.least, "maximum": self.most,
        }  # fmt: skip
        return {key: bound for key, bound in bounds.items() if bound is not None}


def _description(dimension: Dimension, words: tuple[str, ...] = ()) -> str:
    units = fitting(dimension)
    text = describe(dimension)
    text = text[0].upper() + text[1:]
    example = f", such as '10 {units[0]}'" if units else ""
    other = f"; or {alternatives(words)}" if words else ""
    return f"{text}{example}{other}"


@dataclass(frozen=True)
class Formula(FieldType):
    """An expression; without a dimension it is a condition."""

    dimension: Dimension | None
    scope: ScopeKind

    def read(self, value: object, context: ParseContext) -> Expression:
        """The checked expression."""
        if self.scope is ScopeKind.PLANNED and isinstance(value, Map) and "to" in value:
            message = "a coordinate is an expression here, this is a mapping"
            hint = "from where the tool is by a distance leads move: 50 mm, speed: 20 mm/s"
            context.error("TS022", message, span_of(value), hint)
            return NOTHING
        return values.expression(value, self.dimension, self.scope, context) or NOTHING

    def json(self) -> dict[str, Any]:
        """Describes the expression."""
        if self.dimension is None:
            return {"type": "string", "description": "A condition"}
        about = {"description": f"{_description(self.dimension)}; an expression"}
        return quantity_schema(self.dimension) | about


NOTHING = Expression("", Number(0.0, NUMBER), NUMBER)
"""What stands for an expression that cannot be read."""


@dataclass(frozen=True)
class Entries(FieldType):
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

    def read(self, value: object, context: ParseContext) -> tuple[float, ...]:
        """The entries in SI units."""
        if not isinstance(value, Items):
            message = f"a list of {self._count()} is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), self._example())
            return (0.0,) * len(self.dimensions)
        fewest = len(self.dimensions) if self.fewest is None else self.fewest
        if not fewest <= len(value) <= len(self.dimensions) and not value.node.broken:
            message = f"{self._count()} entries are needed here, these are {len(value)}"
            items = value.node.items
            torn = any(adjoin(a, b) for a, b in pairwise(items)) and len(value) > fewest
            hint = "a comma begins a new entry; decimals follow a point, as in 0.5"
            hint = hint if torn else self._example()
            context.error("TS023", message, span_of(value), hint)
        before = len(context.diagnostics)
        result = []
        for entry, dimension in zip(value, self.dimensions, strict=False):
            number = Constant(dimension, above=self.above).read(entry, context)
            assert isinstance(number, float)
            result.append(number)
        sound = value and len(context.diagnostics) == before
        if self.nonzero and sound and max(map(abs, result)) < SMALLEST:
            context.error("TS118", "a direction of length zero", span_of(value))
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
        """Describes the list."""
        most = len(self.dimensions)
        return {
            "type": "array",
            "minItems": most if self.fewest is None else self.fewest,
            "maxItems": most,
            "prefixItems": [Constant(d, above=self.above).json() for d in self.dimensions],
        }


@dataclass(frozen=True)
class QuantityLists(FieldType):
    """A list of lists of constants.

    Attributes:
        one: each of them.
        fewest: how many there have to be.
    """

    one: Entries
    fewest: int

    def read(self, value: object, context: ParseContext) -> tuple[tuple[float, ...], ...]:
        """The lists in SI units."""
        if not isinstance(value, Items):
            message = f"a list of lists is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), self._example())
            return ((0.0,),)
        if value and not any(isinstance(entry, Items) for entry in value):
            message = "a list of lists is needed here, this is one list"
            context.error("TS022", message, span_of(value), self._example())
            return ((0.0,),)
        if len(value) < self.fewest and not value.node.broken:
            message = f"at least {self.fewest} lists are needed here, these are {len(value)}"
            context.error("TS023", message, span_of(value), self._example())
        return tuple(self.one.read(entry, context) for entry in value)

    def _example(self) -> str:
        units = [next(iter(fitting(d)), "") for d in self.one.dimensions[:2]]
        return f"such as [[0, 0], [10 {units[0]}, 0]]"

    def json(self) -> dict[str, Any]:
        """Describes the lists."""
        return {"type": "array", "minItems": self.fewest, "items": self.one.json()}


class DimensionedNumber(float):
    """A number in SI units that knows what it measures.

    Attributes:
        dimension: of the number; None for a bare 0, which measures anything.
    """

    dimension: Dimension | None

    def __new__(cls, value: float, dimension: Dimension | None = None) -> DimensionedNumber:
        """Attaches the dimension."""
        made = super().__new__(cls, value)
        made.dimension = dimension
        return made


@dataclass(frozen=True)
class EitherQuantity(FieldType):
    """A constant that measures one of two things; it is read as `DimensionedNumber`.

    Attributes:
        dimension, other: what it may measure.
        above: it has to be greater than this (SI units).
    """

    dimension: Dimension
    other: Dimension
    above: float | None = None

    def read(self, value: object, context: ParseContext) -> DimensionedNumber:
        """SI units."""
        needed = f"{noun(self.dimension)} or {noun(self.other)}"
        if not isinstance(value, Text | Whole | Real):
            message = f"{needed} is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value))
            return DimensionedNumber(0.0)
        found = values.quantity(value, context)
        if found is None:
            return DimensionedNumber(0.0)
        if self.above is not None and found.value <= self.above:
            context.error("TS118", f"this has to be more than {self.above:g}", span_of(value))
        elif found.bare:
            return DimensionedNumber(found.value)
        elif found.dimension == NUMBER:
            units = alternatives((*fitting(self.dimension), *fitting(self.other)))
            message = f"a number without a unit, where {needed} is needed"
            context.error("TS110", message, span_of(value), f"add a unit: {units}")
        elif found.dimension not in (self.dimension, self.other):
            message = f"{needed} is needed here, this is {describe(found.dimension)}"
            context.error("TS112", message, span_of(value))
        return DimensionedNumber(found.value, found.dimension)

    def json(self) -> dict[str, Any]:
        """Describes the quantity."""
        first, second = _description(self.dimension), _description(self.other)
        about = {"description": f"{first}; or {second[0].lower()}{second[1:]}"}
        return quantity_schema(self.dimension, self.other) | about


@dataclass(frozen=True)
class QuantityList(FieldType):
    """A list of constants, of any length but none.

    Attributes:
        dimension: what an entry measures.
        other: what an entry may measure instead; the entries are then `DimensionedNumber`.
    """

    dimension: Dimension
    other: Dimension | None = None

    def read(self, value: object, context: ParseContext) -> tuple[float, ...]:
        """The entries in SI units."""
        if not isinstance(value, Items):
            message = f"a list is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value))
            return (0.0,)
        if not value and not value.node.broken:
            context.error("TS023", "this list is empty", span_of(value))
        if self.other is not None:
            either = EitherQuantity(self.dimension, self.other)
            return tuple(either.read(entry, context) for entry in value)
        return tuple(values.constant(entry, self.dimension, context) or 0.0 for entry in value)

    def json(self) -> dict[str, Any]:
        """Describes the list."""
        one = Constant(self.dimension)
        entry = (one if self.other is None else EitherQuantity(self.dimension, self.other)).json()
        return {"type": "array", "minItems": 1, "items": entry}


@dataclass(frozen=True)
class ForJoints(FieldType):
    """One constant for all joints, or a list with one for each.

    Attributes:
        dimension: what each measures.
        above: each has to be greater than this (SI units); None for at least 0.
    """

    dimension: Dimension
    above: float | None = None

    def read(self, value: object, context: ParseContext) -> tuple[float, ...]:
        """SI units: one number for all joints, or one for each."""
        entries = value if isinstance(value, Items) else [value]
        if not entries:
            context.error("TS023", "this list is empty", span_of(value))
        one = Constant(self.dimension, above=self.above, least=0)
        return tuple(float(one.read(entry, context)) for entry in entries)

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        one = Constant(self.dimension).json()
        return {"anyOf": [one, {"type": "array", "minItems": 1, "items": one}]}


@dataclass(frozen=True)
class QuantityInterval(FieldType):
    """From a least to a greatest value: `0..90 deg`, `[0, 90 deg]` or `+- 90 deg` about another.

    Attributes:
        dimension: what it measures.
        middle: what `+- x` is about (SI units).
        least: neither end may be smaller (SI units).
    """

    dimension: Dimension
    middle: float = 0.0
    least: float | None = None

    def read(self, value: object, context: ParseContext) -> tuple[float, float] | None:
        """Both ends in SI units; None after reporting why there are none."""
        if isinstance(value, Items):
            ends = self._listed(value, context)
        else:
            ends = self._written(value, context)
        if ends is not None and ends[0] >= ends[1]:
            message, hint = "this interval ends before it begins", "write the smaller first"
            if ends[0] == ends[1]:
                message, hint = "this interval has no width", "its ends have to differ"
            context.error("TS711", message, span_of(value), hint)
            return None
        if ends is not None and self.least is not None and ends[0] < self.least:
            least = in_si(self.least, self.dimension) if self.least else "0"
            context.error("TS118", f"this has to begin at {least} or above", span_of(value))
            return None
        return ends

    def _listed(self, value: Items, context: ParseContext) -> tuple[float, float] | None:
        """The two entries of a list."""
        entries = [values.constant(entry, self.dimension, context) for entry in value]
        if len(entries) != 2 and not value.node.broken:
            message = f"an interval has 2 ends, this list has {len(value)}"
            context.error("TS023", message, span_of(value), self._form())
        ends = [entry for entry in entries if entry is not None]
        return (ends[0], ends[1]) if len(ends) == len(entries) == 2 else None

    def _written(self, value: object, context: ParseContext) -> tuple[float, float] | None:
        """The ends of `a..b`, `a +- b` or `+- b`."""
        node = values.parsed(value, "uncertain", context, "an interval")
        if node is None:
            return None
        assert isinstance(value, Text | Whole | Real)
        checked = check(node, context.scope(ScopeKind.CONSTANT), self.dimension)
        node, problems = checked.tree, checked.problems
        if not problems and not isinstance(node, IntervalNode | SpreadNode):
            message = f"an interval of {describe(self.dimension)} is needed here"
            problems = (Problem("TS023", message, node.start, node.end, self._form()),)
        share = isinstance(node, SpreadNode) and is_share(node.x) and self.dimension != NUMBER
        if not problems and share and not self.middle:
            problems = (share_of_zero(node),)
        if not problems and isinstance(node, IntervalNode):
            problems = tuple(
                share_problems(node.low, node.high, lambda n: values.known(n, context))
            )
        context.problems(value, problems)
        if problems:
            return None
        if isinstance(node, SpreadNode):
            half = values.number(value, node.x, context)
            if half is not None and half <= 0:
                most = self._example()
                hint = f"+- {most} reaches {most} to either side"
                message = "this reaches to neither side"
                context.problems(value, (Problem("TS711", message, node.start, node.end, hint),))
                return None
            if half is None:
                return None
            half *= abs(self.middle) if share else 1.0
            return self.middle - half, self.middle + half
        assert isinstance(node, IntervalNode)
        low, high = (values.number(value, end, context) for end in (node.low, node.high))
        return None if low is None or high is None else (low, high)

    def _form(self) -> str:
        most = self._example()
        return f"write both ends, such as 0..{most} or [0, {most}], or +- {most}"

    def _example(self) -> str:
        return f"90 {next(iter(fitting(self.dimension)), '')}".rstrip()

    def json(self) -> dict[str, Any]:
        """Describes the interval."""
        unit = fitting(self.dimension)[0]
        text = f"From a least to a greatest value in {unit}: 'a..b', [a, b] or '+- x'"
        both = Entries((self.dimension,) * 2).json()
        return {
            "description": text,
            "anyOf": [{"type": "string"}, both],
            "examples": [f"0..90 {unit}", [0, f"90 {unit}"], f"+- 90 {unit}"],
        }


@dataclass(frozen=True)
class IntervalAroundZero(QuantityInterval):
    """The same about 0."""

    def read(self, value: object, context: ParseContext) -> tuple[float, float]:
        """Both ends in SI units."""
        ends = QuantityInterval.read(self, value, context)
        if ends is None:
            return 0.0, 0.0
        if not ends[0] <= 0 <= ends[1]:
            message = "this leaves out 0, where the mechanism is as it is declared"
            hint = "count from there: the run begins at 0"
            context.error("TS118", message, span_of(value), hint)
        return ends


@dataclass(frozen=True)
class PositiveInterval(QuantityInterval):
    """The same of what is more than 0."""

    def read(self, value: object, context: ParseContext) -> tuple[float, float]:
        """Both ends in SI units; 1 and 2 after reporting why there are none."""
        ends = QuantityInterval.read(self, value, context)
        if ends is not None and ends[0] <= 0:
            context.error("TS118", "both ends have to be more than 0", span_of(value))
        return ends if ends is not None and ends[0] > 0 else (1.0, 2.0)
