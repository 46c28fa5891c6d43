"""`sweep`: how many random worlds a task is to be tried in, and how often it is to succeed."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from taskspec.deferred_methods import dataclass
from taskspec.expression import FloatAlgebra, Problem, ScopeKind, check, evaluate
from taskspec.expression.tree import Compare, Name, Node, walk
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.model import Model
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.words import Count
from taskspec.text.codes import register
from taskspec.text.data import Items, Map, Text
from taskspec.text.suggest import suggestion
from taskspec.text.units import NUMBER

register({"TS712": "an expectation of a sweep that cannot be read"})

SUCCESS = "success"
"""Of all expectations together, in a run that came to its end."""

_FORM = "such as success >= 99 %"


@dataclass(frozen=True, slots=True)
class RateExpectation:
    """How often something is to hold in random worlds.

    Attributes:
        what: `success`, or the name of an expectation.
        least: probability that it is to have.
        text: as written.
    """

    what: str
    least: float
    text: str


@dataclass(frozen=True)
class RateExpectations(FieldType):
    """One relation such as `success >= 99 %`, or a list of them."""

    def read(self, value: object, context: ParseContext) -> tuple[RateExpectation, ...]:
        """The relations in the order in which they are written."""
        if isinstance(value, Map):
            message = f"a relation is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), _FORM)
            return ()
        entries = value if isinstance(value, Items) else [value]
        found = (_relation(entry, context) for entry in entries)
        return tuple(each for each in found if each is not None)

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        one = {"type": "string", "description": "'success >= 99 %'"}
        return {"anyOf": [one, {"type": "array", "items": one}]}


def _relation(value: object, context: ParseContext) -> RateExpectation | None:
    node = values.parsed(value, "logic", context, "a relation")
    if node is None:
        return None
    assert isinstance(value, Text) or not isinstance(node, Compare)
    if not isinstance(node, Compare) or not isinstance(node.left, Name) or node.op not in _OPS:
        _report(value, node, "a sweep expects how often something holds", _FORM, context)
        return None
    what, known = str(node.left), (SUCCESS, *_named(context))
    if what not in known:
        hint = suggestion(what, known, "known here")
        _report(value, node.left, f"{what!r} is no rate", hint, context)
        return None
    if any(isinstance(each, Name) and str(each) not in context.params for each in walk(node.right)):
        _report(value, node.right, "a rate is compared with a number", _FORM, context)
        return None
    checked = check(node.right, context.scope(ScopeKind.CONSTANT), NUMBER)
    context.problems(value, checked.problems)
    if checked.problems or not values.still(value, node.right, context):
        return None
    least = evaluate(node.right, FloatAlgebra(), lambda name: values.known(name, context))
    if not 0 < least < 1:
        message = f"a probability of {100 * least:g} % is never known from worlds that were tried"
        hint = "write one between 0 and 100 %, such as 99 %"
        _report(value, node.right, message, hint, context)
        return None
    return RateExpectation(what, least, str(value))


_OPS = (">", ">=")


def _named(context: ParseContext) -> list[str]:
    expected = context.data.get("expect")
    return list(expected) if isinstance(expected, Map) else []


def _report(value: object, node: Node, message: str, hint: str, context: ParseContext) -> None:
    context.problems(value, (Problem("TS712", message, node.start, node.end, hint),))


class Sweep(Model):
    """What `taskspec sweep` does where its options say nothing else.

    Attributes:
        worlds: how many random worlds.
        expect: how often what is to hold.
    """

    noun = "a sweep"
    example = "sweep: {worlds: 1000, expect: success >= 99 %}"

    worlds: Annotated[int, Count()] = Field(100, title="Random worlds")
    expect: Annotated[tuple[RateExpectation, ...], RateExpectations()] = Field(
        (), title="How often what is to hold"
    )
