"""Joint positions of a path: one list, a list of lists, or a list of expressions of time."""

from __future__ import annotations

from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ExpressionError, ScopeKind, parse
from taskspec.expression.tree import Name, walk
from taskspec.spec.field_type import FieldType
from taskspec.spec.joint_expressions import JointExpressions
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.quantities import QuantityList
from taskspec.text.data import Items, Text
from taskspec.text.units import ANGLE, LENGTH

#: What makes an expression one of time.
_CLOCKS = {"t", "clock"}


def goes_by_time(value: object) -> bool:
    """Whether the joints of a path are given as expressions of time, as a file has them."""
    return isinstance(value, Items) and any(_of_time(entry) for entry in value)


def _of_time(entry: object) -> bool:
    if not isinstance(entry, Text):
        return False
    try:
        names = walk(parse(entry, "sum"))
        return any(isinstance(node, Name) and str(node) in _CLOCKS for node in names)
    except ExpressionError:
        return False


@dataclass(frozen=True)
class JointTargets(FieldType):
    """The joint positions that a path leads to, one after the other, or where it is at each time.

    Attributes:
        one: each of the targets.
        planned: the expressions of time.
    """

    one: QuantityList = QuantityList(ANGLE, LENGTH)
    planned: JointExpressions = JointExpressions(ANGLE, LENGTH, ScopeKind.PLANNED)

    def read(
        self, value: object, context: ParseContext
    ) -> tuple[tuple[float, ...], ...] | tuple[Expression, ...]:
        """Each target in SI units, with entries that know what they measure; or expressions."""
        if goes_by_time(value):
            return self.planned.read(value, context)
        listed = isinstance(value, Items) and any(isinstance(entry, Items) for entry in value)
        for target in value if isinstance(value, Items) and listed else ():
            if goes_by_time(target):
                message = "an expression of time among targets, which are gone to one after another"
                hint = "one list of expressions is a motion: joints: [20 deg*sin(t/(1 s)), 40 deg]"
                context.error("TS606", message, span_of(target), hint)
                return ((0.0,),)
        targets = value if isinstance(value, Items) and listed else [value]
        return tuple(self.one.read(target, context) for target in targets)

    def json(self) -> dict[str, Any]:
        """Describes its forms; expressions are written as quantities are."""
        one = self.one.json()
        return {"anyOf": [one, {"type": "array", "minItems": 1, "items": one}]}
