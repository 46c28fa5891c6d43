"""`params`: named quantities."""

from __future__ import annotations

import re
from graphlib import CycleError, TopologicalSorter
from typing import Any

from taskspec.spec import values
from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext, kind_of, span_of
from taskspec.spec.quantities import quantity_schema
from taskspec.text.codes import register
from taskspec.text.data import Map, Text
from taskspec.text.units import Quantity

register({"TS127": "params that define each other in a circle"})

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


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
        return {"type": "object", "additionalProperties": quantity_schema()}


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
        result = values.quantity(data[name], context)
        if result is None:
            context.broken.add(name)
        else:
            context.params[name] = result


def _uses(value: object) -> set[str]:
    return set(_WORD.findall(value)) if isinstance(value, Text) else set()
