"""`follows`: the name of a mechanism, or an expression of other axes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, Problem
from taskspec.expression.scope import AXIS_COORDINATES
from taskspec.expression.tree import Name, walk
from taskspec.spec.field_type import FieldType
from taskspec.spec.fields import MECHANISM_NAME, MECHANISMS
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Formula
from taskspec.text.codes import register
from taskspec.text.data import Text

register({"TS261": "a coupling that names no other axis"})


#: Of a word alone, which may also have been meant as an axis.
_MECHANISM = replace(MECHANISM_NAME, unfit="'{}' is no mechanism, and no axis of the frame")


@dataclass(frozen=True)
class Followed(FieldType):
    """What an axis follows.

    A single word is the name of a mechanism, unless it is an axis or a param.

    Attributes:
        expression: of other axes.
    """

    expression: Formula

    def read(self, value: object, context: ParseContext) -> str | Expression:
        """The name of a mechanism, or the checked expression."""
        if isinstance(value, Text) and _is_name(value, context):
            return _MECHANISM.read(value, context)
        before = len(context.diagnostics)
        expression = self.expression.read(value, context)
        sound = len(context.diagnostics) == before
        names = {str(n) for n in walk(expression.tree) if isinstance(n, Name)}
        if sound and not names & AXIS_COORDINATES.keys():
            hint = "follow one, as in 2 * x; what follows none stands at 'position'"
            node = expression.tree
            problem = Problem("TS261", "this names no other axis", node.start, node.end, hint)
            context.problems(value, (problem,))
        return expression

    def json(self) -> dict[str, Any]:
        """Describes both."""
        return self.expression.json() | {
            "description": "The name of a mechanism, or an expression of other axes, such as 2 * x",
        }


def _is_name(value: Text, context: ParseContext) -> bool:
    """Whether a text can be nothing but the name of an object."""
    word = str(value)
    if word in context.of_kind(*MECHANISMS):
        return True
    known = word in AXIS_COORDINATES or word in context.params or word in context.broken
    return word.isidentifier() and not known
