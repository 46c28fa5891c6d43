"""Scalars as values: constants in SI units and checked expressions."""

from __future__ import annotations

import math

from taskspec.expression import (
    Expression,
    ExpressionError,
    FloatAlgebra,
    Problem,
    ScopeKind,
    check,
    evaluate,
    infer,
    parse,
)
from taskspec.expression.intervals import interval_problems
from taskspec.expression.parse import Start
from taskspec.expression.scope import CONSTANTS
from taskspec.expression.tree import Name, Node, Number, walk
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.text.codes import register
from taskspec.text.data import Real, Text, Whole
from taskspec.text.units import LARGEST, NUMBER, Dimension, Quantity, describe

register(
    {
        "TS117": "a value that is not finite",
        "TS150": "a live parameter where nothing may change while a stage runs",
    }
)

#: Where an expression is evaluated while a stage runs, or over what was recorded of it.
_RUNNING = (
    *(ScopeKind.COUPLING, ScopeKind.PLANNED, ScopeKind.REFERENCE),
    *(ScopeKind.GUARD, ScopeKind.EXPECT, ScopeKind.REWARD),
)

_FLOATS = FloatAlgebra()


def parsed(value: object, start: Start, context: ParseContext, needed: str) -> Node | None:
    """The tree of a scalar, or None after reporting why there is none.

    Args:
        value: a datum of the file.
        start: what it has to be.
        context: the pass.
        needed: what its place needs, in words.
    """
    if not isinstance(value, Text | Whole | Real):
        message = f"{needed} is needed here, this is {kind_of(value)}"
        context.error("TS022", message, span_of(value), _kind_hint(value, start))
        return None
    if not isinstance(value, Text):
        # A YAML number may be written as `.5`, which is no number of the expression language.
        return Number(float(value), NUMBER, start=0, end=len(value.node.value))
    try:
        return parse(value, start)
    except ExpressionError as error:
        context.problems(value, error.problems)
        return None


def expression(
    value: object, dimension: Dimension | None, kind: ScopeKind, context: ParseContext
) -> Expression | None:
    """A checked expression, or None after reporting what is wrong with it.

    Args:
        value: a datum of the file.
        dimension: what its place requires; None for a condition.
        kind: where it stands.
        context: the pass.
    """
    start: Start = "sum" if dimension is not None else "logic"
    needed = describe(dimension) if dimension is not None else "a condition"
    node = parsed(value, start, context, needed)
    if node is None:
        return None
    assert isinstance(value, Text | Whole | Real)
    checked = check(node, context.scope(kind), dimension)
    context.problems(value, checked.problems)
    if checked.problems:
        return None
    ends = tuple(interval_problems(checked.tree, lambda name: known(name, context)))
    context.problems(value, ends)
    if not all(problem.warning for problem in ends):
        return None
    if kind not in _RUNNING and not still(value, node, context):
        return None
    fixed = all(n.path[0] in context.params for n in walk(node) if isinstance(n, Name))
    if dimension is not None and fixed and number(value, node, context, live=True) is None:
        return None
    return Expression(value.node.value, checked.tree, checked.dimension, value.node.origin)


def known(name: Name, context: ParseContext) -> float:
    """The value of a param or constant; nan of any other name."""
    if str(name) in CONSTANTS:
        return CONSTANTS[str(name)][0]
    param = context.params.get(str(name))
    return math.nan if param is None else param.value


def constant(value: object, dimension: Dimension, context: ParseContext) -> float | None:
    """A constant in SI units, or None after reporting what is wrong with it.

    None is also returned, in silence, if it uses a param that is itself wrong.
    """
    node = parsed(value, "sum", context, describe(dimension))
    if node is None:
        return None
    checked = check(node, context.scope(ScopeKind.CONSTANT), dimension)
    context.problems(value, checked.problems)
    return None if checked.problems else number(value, node, context)


def measures(value: object, dimension: Dimension, context: ParseContext) -> bool:
    """Whether a datum is a constant of a dimension; nothing is reported."""
    if not isinstance(value, Text):
        return False
    try:
        kind, problems = infer(parse(value, "sum"), context.scope(ScopeKind.CONSTANT))
    except ExpressionError:
        return False
    return not problems and kind.kind == "number" and kind.dimension == dimension


def quantity(value: object, context: ParseContext) -> Quantity | None:
    """A constant of whatever dimension, or None after reporting what is wrong with it."""
    found = measured(value, context)
    return None if found is None or not still(value, found[1], context) else found[0]


def measured(value: object, context: ParseContext) -> tuple[Quantity, Node] | None:
    """A quantity of whatever dimension with its tree, or None after reporting what is wrong.

    It may follow from live params, which have their declared values in it.
    """
    node = parsed(value, "sum", context, "a quantity")
    if node is None:
        return None
    kind, problems = infer(node, context.scope(ScopeKind.CONSTANT))
    if not problems and kind.kind == "condition":
        problems = (Problem("TS114", "a quantity is needed here", node.start, node.end),)
    context.problems(value, problems)
    if problems or kind.kind == "unknown":
        return None
    result = number(value, node, context, live=True)
    if result is None:
        return None
    return Quantity(result, kind.dimension or NUMBER, bare=kind.dimension is None), node


def live_names(node: Node, context: ParseContext) -> list[Name]:
    """The live params that stand in a tree."""
    params = context.params
    names = (n for n in walk(node) if isinstance(n, Name))
    return [n for n in names if str(n) in params and params[str(n)].live]


def still(value: object, node: Node, context: ParseContext) -> bool:
    """Whether a tree has no live param, which is reported."""
    live = live_names(node, context)
    for name in live[:1]:
        message = f"'{name}' is live, and this is settled before a stage runs"
        hint = (
            "use a param without 'live' here; live ones stand in set points, gains and conditions"
        )
        context.problems(value, (Problem("TS150", message, name.start, name.end, hint),))
    return not live


def number(value: object, node: Node, context: ParseContext, *, live: bool = False) -> float | None:
    """The value of a checked constant tree; None if a part of it is broken or infinite.

    Args:
        value: the datum that it is of.
        node: the tree.
        context: the pass.
        live: whether live params may stand in it, with their declared values.
    """
    names = [n.path[0] for n in walk(node) if isinstance(n, Name)]
    if any(name in context.broken for name in names) or not (live or still(value, node, context)):
        return None
    result = evaluate(node, _FLOATS, lambda name: _lookup(name, context))
    if abs(result) <= LARGEST:
        return result
    hint = "mind what divides, and what stands under a root or in a logarithm"
    problem = Problem("TS117", "this has no finite value", node.start, node.end, hint)
    if math.isfinite(result):
        message = f"this comes to {result:g} in SI units, where numbers go up to {LARGEST:g}"
        problem = Problem("TS118", message, node.start, node.end)
    context.problems(value, (problem,))
    return None


def _lookup(name: Name, context: ParseContext) -> float:
    word = name.path[0]
    return context.params[word].value if word in context.params else CONSTANTS[word][0]


def _kind_hint(value: object, start: Start) -> str:
    if start == "uncertain":
        return "such as 5..20 N, or 12 N +- 10 %"
    if kind_of(value) == "true or false":
        return "a word in an expression is a name; true and false are not"
    return ""
