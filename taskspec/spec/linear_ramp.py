"""`{from: -2 N, to: -40 N, time: 3 s}`: a set point that goes evenly from one value to another."""

from __future__ import annotations

from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, ScopeKind
from taskspec.spec import values
from taskspec.spec.parse_context import ParseContext, span_of
from taskspec.spec.quantities import NOTHING, Constant, Formula
from taskspec.text import nodes
from taskspec.text.data import Map, Real, Text, Whole, text_of
from taskspec.text.spliced import joined
from taskspec.text.suggest import suggestion
from taskspec.text.units import TIME, Dimension, fitting

#: What other systems call the time.
_TIMES = ("over", "in", "duration")
#: What other systems call its ends.
_ENDS = {
    **dict.fromkeys(("start", "begin", "initial", "min"), "from"),
    **dict.fromkeys(("end", "stop", "final", "target", "max"), "to"),
}


def linear_ramp(
    value: Map, dimension: Dimension, kind: ScopeKind, context: ParseContext
) -> Expression | None:
    """The expression a + (b - a) clamp(t/T, 0, 1), or None after reporting what is wrong.

    Args:
        value: with a, b and T under `from`, `to` and `time`.
        dimension: of a and b.
        kind: where it stands.
        context: the pass.
    """
    time_key = next((key for key in ("time", *_TIMES) if key in value), "time")
    keys = {"from": "from", "to": "to", "time": time_key}
    for key in value.keys() - {*keys.values()}:
        meant = _ENDS.get(key.lower(), "")
        hint = f"did you mean '{meant}'?" if meant else suggestion(key, keys, "keys")
        context.error("TS020", f"unknown key '{key}' in a ramp", value.node.key_span(key), hint)
    missing = [name for name, key in keys.items() if key not in value]
    if missing and value.keys() <= {*keys.values()} and not value.node.broken:
        unit = next(iter(fitting(dimension)), "")
        hint = f"such as {{from: 0, to: -40 {unit}, time: 3 s}}"
        context.error("TS021", f"a linear ramp needs the key '{missing[0]}'", span_of(value), hint)
    before = len(context.diagnostics)
    for key in ("from", "to"):
        if key in value:
            values.expression(value[key], dimension, kind, context)
    if time_key in value:
        time = values.constant(value[time_key], TIME, context)
        if time is not None and time <= 0:
            context.error("TS118", "this has to be more than 0", span_of(value[time_key]))
    parts = [value.get(key) for key in keys.values()]
    if missing or len(context.diagnostics) > before:
        return None
    first, last, during = (part.node for part in parts if isinstance(part, Text | Whole | Real))
    place = nodes.pointer(value.node)
    text = joined(
        ("(", first, ") + ((", last, ") - (", first, "))*clamp(t/(", during, "), 0, 1)"), place
    )
    return values.expression(text_of(text), dimension, kind, context)


@dataclass(frozen=True)
class RampedFormula(Formula):
    """An expression, or the two ends and the time of a linear ramp."""

    def read(self, value: object, context: ParseContext) -> Expression:
        """The checked expression; of a ramp that which has its values."""
        if not isinstance(value, Map) or self.dimension is None:
            return Formula.read(self, value, context)
        return linear_ramp(value, self.dimension, self.scope, context) or NOTHING

    def json(self) -> dict[str, Any]:
        """Describes both forms."""
        assert self.dimension is not None
        end = Formula.json(self)
        unit = fitting(self.dimension)[0]
        time = Constant(TIME).json() | {
            "title": "Time",
            "description": "Time from one to the other",
            "examples": ["3 s"],
        }
        ends = {
            "from": end
            | {"title": "From", "description": "At the start of the stage"}
            | {"examples": [f"-2 {unit}"]},
            "to": end
            | {"title": "To", "description": "From the end of the time on"}
            | {"examples": [f"-40 {unit}"]},
        }
        ramp = {
            "type": "object",
            "properties": ends | dict.fromkeys(("time", *_TIMES), time),
            "required": ["from", "to"],
            "additionalProperties": False,
        }
        return {"description": end["description"], "anyOf": [end, ramp]}
