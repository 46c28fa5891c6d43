"""Joint positions of a path: one list, or a list of lists."""

from __future__ import annotations

from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import QuantityList
from taskspec.text.data import Items
from taskspec.text.units import ANGLE, LENGTH


@dataclass(frozen=True)
class JointTargets(FieldType):
    """The joint positions that a path leads to, one after the other.

    Attributes:
        one: each of them.
    """

    one: QuantityList = QuantityList(ANGLE, LENGTH)

    def read(self, value: object, context: ParseContext) -> tuple[tuple[float, ...], ...]:
        """Each target in SI units; its entries know what they measure."""
        listed = isinstance(value, Items) and any(isinstance(entry, Items) for entry in value)
        targets = value if isinstance(value, Items) and listed else [value]
        return tuple(self.one.read(target, context) for target in targets)

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        one = self.one.json()
        return {"anyOf": [one, {"type": "array", "minItems": 1, "items": one}]}
