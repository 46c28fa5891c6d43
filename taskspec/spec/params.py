"""`params`: named quantities, of which some may be set while a stage runs."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from graphlib import CycleError, TopologicalSorter
from typing import Any, ClassVar, TypeVar

from taskspec.deferred_methods import dataclass
from taskspec.expression import ExpressionError, FloatAlgebra, ScopeKind, evaluate, infer, parse
from taskspec.expression.evaluate import Algebra
from taskspec.expression.scope import CONSTANTS
from taskspec.expression.tree import IntervalNode, Name, Node, Number, SpreadNode, walk
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.quantities import QuantityInterval, quantity_schema
from taskspec.text.codes import register
from taskspec.text.data import Map, Text
from taskspec.text.suggest import suggestion
from taskspec.text.units import NUMBER, TIME, Dimension, Quantity, describe, fitting, noun, show

register({"TS127": "params that define each other in a circle"})

T = TypeVar("T")

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
_KEYS = ("value", "live", "rate")
_FORM = "such as press: {value: 12 N, live: 5..20 N, rate: 10 N/s}"


@dataclass(frozen=True, slots=True)
class LiveParam(Quantity):
    """A param that may be set while a stage runs; `value` is where a run begins.

    Attributes:
        low: least value [SI].
        high: greatest value [SI].
        rate: how fast it goes to what it is set to, by the second [SI]; 0 where it jumps there.
    """

    low: float = -math.inf
    high: float = math.inf
    rate: float = 0.0

    live: ClassVar[bool] = True


@dataclass(frozen=True, slots=True)
class FollowingParam(Quantity):
    """A param that follows from live ones.

    Attributes:
        tree: its checked expression.
    """

    tree: Node = Number(0.0, NUMBER)

    live: ClassVar[bool] = True


def live_params(params: Mapping[str, Quantity]) -> dict[str, LiveParam]:
    """Those that may be set, in their order."""
    return {name: param for name, param in params.items() if isinstance(param, LiveParam)}


def slots_of(params: Mapping[str, Quantity], tree: Node) -> set[str]:
    """The live params that an expression uses, those that its other params follow from among them.

    Args:
        params: of the task.
        tree: of the expression.
    """
    found: set[str] = set()
    for name in {str(node) for node in walk(tree) if isinstance(node, Name)} & params.keys():
        match params[name]:
            case LiveParam():
                found.add(name)
            case FollowingParam(tree=of):
                found |= slots_of(params, of)
    return found


def worths(
    params: Mapping[str, Quantity], algebra: Algebra[T], slot: Callable[[str], T]
) -> dict[str, T]:
    """All params as numbers of some kind.

    Args:
        params: in an order in which each comes after those that it uses.
        algebra: the operations on such numbers.
        slot: the value of a live one, by its name.
    """
    found: dict[str, T] = {}

    def lookup(name: Name) -> T:
        text = str(name)
        return found[text] if text in found else algebra.number(CONSTANTS[text][0])

    for name, param in params.items():
        match param:
            case LiveParam():
                found[name] = slot(name)
            case FollowingParam():
                found[name] = evaluate(param.tree, algebra, lookup)
            case _:
                found[name] = algebra.number(param.value)
    return found


def with_values(params: Mapping[str, Quantity], live: Mapping[str, float]) -> dict[str, Quantity]:
    """The params with other values of live ones, as if the file declared these.

    Args:
        params: in an order in which each comes after those that it uses.
        live: other values, by name [SI].
    """
    found = worths(params, FloatAlgebra(), lambda name: live.get(name, params[name].value))
    return {
        name: replace(param, value=found[name]) if param.live else param
        for name, param in params.items()
    }


class Params(FieldType):
    """The params, which are evaluated before anything else is read."""

    def read(self, value: object, context: ParseContext) -> dict[str, Quantity]:
        """The evaluated params."""
        if not isinstance(value, Map):
            message = f"'params' is a mapping of names to quantities, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), "params: {press: 15 N}")
        return dict(context.params)

    def json(self) -> dict[str, Any]:
        """Describes the mapping."""
        live = {
            "type": "object",
            "title": "Live param",
            "description": "A param that may be set while a stage runs",
            "properties": {
                "value": quantity_schema() | {"description": "Where a run begins"},
                "live": {
                    "description": "From the least to the greatest value: 'a..b', [a, b], or "
                    "'+- x' about the value",
                    "type": ["string", "array"],
                    "examples": ["5..20 N", "+- 5 N"],
                },
                "rate": quantity_schema()
                | {"description": "How fast it goes to what it is set to; without it, it jumps"},
            },
            "required": ["value", "live"],
            "additionalProperties": False,
            "examples": [{"value": "12 N", "live": "5..20 N", "rate": "10 N/s"}],
        }
        return {"type": "object", "additionalProperties": {"anyOf": [quantity_schema(), live]}}


def evaluate_params(context: ParseContext) -> None:
    """Evaluates all params, in whatever order they use each other, into `context`."""
    data = context.data.get("params")
    if not isinstance(data, Map):
        return
    context.broken.update(data.node.entries.keys() - data.keys())
    uses = {name: _uses(value) & data.keys() for name, value in data.items()}
    try:
        order = list(TopologicalSorter(uses).static_order())
    except CycleError as error:
        circle = list(reversed(error.args[1]))
        text = " uses ".join(circle)
        span = data.node.key_span(circle[0])
        hint = "give one of them a value of its own"
        context.error("TS127", f"params define each other in a circle: {text}", span, hint)
        context.broken.update(data)
        return
    for name in order:
        value = data[name]
        result = _live(value, context) if isinstance(value, Map) else _plain(value, context)
        if result is None:
            context.broken.add(name)
        else:
            context.params[name] = result


def _plain(value: object, context: ParseContext) -> Quantity | None:
    """A param that is a quantity, which may follow from live ones."""
    found = values.measured(value, context)
    if found is None:
        return None
    quantity, tree = found
    if not values.live_names(tree, context):
        return quantity
    return FollowingParam(quantity.value, quantity.dimension, quantity.bare, tree)


def _live(value: Map, context: ParseContext) -> LiveParam | None:
    """A param that may be set; None after reporting what is wrong with it."""
    before = len(context.diagnostics)
    for key in value.keys() - {*_KEYS}:
        hint = suggestion(key, _KEYS, "keys")
        context.error("TS020", f"unknown key '{key}' in a param", value.node.key_span(key), hint)
    missing = [key for key in _KEYS[:2] if key not in value]
    if missing and len(context.diagnostics) == before and not value.node.broken:
        message = f"a param that may be set needs the key '{missing[0]}'"
        context.error("TS021", message, context.key_of(value), _FORM)
    if missing or (declared := values.quantity(value["value"], context)) is None:
        return None
    if declared.bare:
        # A lone 0 measures nothing: the interval says what.
        declared = replace(declared, dimension=_measured_by(value["live"], context))
    dimension = declared.dimension
    ends = QuantityInterval(dimension, declared.value).read(value["live"], context)
    if ends is None:
        return None
    low, high = ends
    if not low <= declared.value <= high:
        unit = next(iter(fitting(dimension)), "")
        message = f"this is not within {show(low, unit)} and {show(high, unit)}, which it may be"
        context.error("TS118", message, span_of(value["value"]), "a run begins with it")
    rate = 0.0
    if "rate" in value:
        rate = _rate(value["rate"], dimension, context)
    if len(context.diagnostics) > before:
        return None
    return LiveParam(declared.value, dimension, False, low, high, rate)


def _rate(value: object, dimension: Dimension, context: ParseContext) -> float:
    """How fast a param goes to what it is set to [SI by s]; 0 after reporting what is wrong."""
    found = values.quantity(value, context)
    if found is None:
        return 0.0
    unit = next(iter(fitting(dimension)), "1")
    if found.value <= 0:
        hint = "leave it out, and the param jumps to what it is set to"
        context.error("TS118", "this has to be more than 0", span_of(value), hint)
    elif found.dimension != dimension / TIME:
        message = f"a rate of {noun(dimension)} is needed here, this is {describe(found.dimension)}"
        context.error("TS112", message, span_of(value), f"such as 10 {unit}/s")
    return found.value


def _measured_by(value: object, context: ParseContext) -> Dimension:
    """What an interval measures, as far as that can be read: a plain number where it cannot."""
    scope = context.scope(ScopeKind.CONSTANT)
    for text in value if isinstance(value, list) else [value]:
        if not isinstance(text, Text):
            continue
        try:
            node = parse(text, "uncertain")
        except ExpressionError:
            continue
        match node:
            case IntervalNode(low, high):
                parts: tuple[Node, ...] = (low, high)
            case SpreadNode(x):
                parts = (x,)
            case _:
                parts = (node,)
        for part in parts:
            found, _ = infer(part, scope)
            if found.dimension is not None:
                return found.dimension
    return NUMBER


def _uses(value: object) -> set[str]:
    if isinstance(value, Map):
        return {name for each in value.values() for name in _uses(each)}
    if isinstance(value, list):
        return {name for each in value for name in _uses(each)}
    return set(_WORD.findall(value)) if isinstance(value, Text) else set()
