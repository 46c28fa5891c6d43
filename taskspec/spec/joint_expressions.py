"""A list of expressions, one for each joint: angles or moments, on slides lengths or forces."""

from __future__ import annotations

from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ExpressionError, ScopeKind, infer, parse
from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.quantities import NOTHING, Formula, quantity_schema
from taskspec.text.data import Items, Text
from taskspec.text.units import Dimension, fitting, noun


@dataclass(frozen=True)
class JointExpressions(FieldType):
    """Expressions of the joints, in their order.

    How many there are, and which joints slide, is known once the robot is.

    Attributes:
        dimension: what an entry measures of a joint that turns.
        other: what it measures of one that slides.
        scope: what the expressions may use.
    """

    dimension: Dimension
    other: Dimension
    scope: ScopeKind

    def read(self, value: object, context: ParseContext) -> tuple[Expression, ...]:
        """The checked expressions."""
        if not isinstance(value, Items):
            message = f"a list with {noun(self.dimension)} for each joint is needed here, this is "
            unit = fitting(self.dimension)[0]
            hint = f"such as [10 {unit}, 0]"
            context.error("TS022", message + kind_of(value), span_of(value), hint)
            return (NOTHING,)
        if not value and not value.node.broken:
            context.error("TS023", "this list is empty", span_of(value))
        return tuple(
            values.expression(entry, self._measured(entry, context), self.scope, context) or NOTHING
            for entry in value
        )

    def _measured(self, entry: object, context: ParseContext) -> Dimension:
        """What an entry has to measure: that of a slide where it does, else that of a hinge."""
        if isinstance(entry, Text):
            try:
                kind, _ = infer(parse(entry, "sum"), context.scope(self.scope))
            except ExpressionError:
                return self.dimension
            if kind.dimension == self.other:
                return self.other
        return self.dimension

    def json(self) -> dict[str, Any]:
        """Describes the list."""
        one = Formula(self.dimension, self.scope).json() | quantity_schema(
            self.dimension, self.other
        )
        return {"type": "array", "minItems": 1, "items": one}
