"""`expect`: what counts as success."""

from __future__ import annotations

from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.text.data import Items, Map
from taskspec.text.expression import Expression, ScopeKind


@dataclass(frozen=True, slots=True)
class Expectation:
    """A condition on the whole run, or on one stage of it.

    Attributes:
        expression: the checked condition.
        text: as written, on one line.
    """

    expression: Expression
    text: str


def _condition(entry: object, context: ParseContext) -> Expression | None:
    if isinstance(entry, Map) and len(entry) == 1:
        (key,) = entry
        message = "a condition is needed here, this is a mapping"
        hint = f"write the relation instead of the colon: {key} < …"
        context.error("TS022", message, span_of(entry), hint)
        return None
    return values.expression(entry, None, ScopeKind.EXPECT, context)


@dataclass(frozen=True)
class Expectations(FieldType):
    """A list of conditions."""

    def read(self, value: object, context: ParseContext) -> tuple[Expectation, ...]:
        """The expectations in the order in which they are written."""
        if not isinstance(value, Items):
            message = f"a list of conditions is needed here, this is {kind_of(value)}"
            context.error("TS022", message, span_of(value), "begin each with '- '")
            return ()
        if not context.stages:
            return ()  # What is expected of stages that are not there is no further mistake.
        found = (_condition(entry, context) for entry in value)
        return tuple(Expectation(e, str(e)) for e in found if e is not None)

    def json(self) -> dict[str, Any]:
        """Describes the list."""
        return {"type": "array", "items": {"type": ["string", "boolean"]}}
