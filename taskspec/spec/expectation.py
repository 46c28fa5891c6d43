"""`expect`: what counts as success."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from taskspec.spec import values
from taskspec.spec.kinds import Kind
from taskspec.spec.reading import Reading, kind_of, span_of
from taskspec.text.data import Items
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


@dataclass(frozen=True)
class Expectations(Kind):
    """A list of conditions."""

    def read(self, value: object, reading: Reading) -> tuple[Expectation, ...]:
        """Return the expectations in the order in which they are written."""
        if not isinstance(value, Items):
            message = f"a list of conditions is needed here, this is {kind_of(value)}"
            reading.error("TS022", message, span_of(value), "begin each with '- '")
            return ()
        found = (values.expression(v, None, ScopeKind.EXPECT, reading) for v in value)
        return tuple(Expectation(e, str(e)) for e in found if e is not None)

    def json(self) -> dict[str, Any]:
        """Describe the list."""
        return {"type": "array", "items": {"type": ["string", "boolean"]}}
