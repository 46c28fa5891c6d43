"""`params`: named quantities."""

from __future__ import annotations

import re
from typing import Any

from taskspec.spec import values
from taskspec.spec.kinds import Kind
from taskspec.spec.reading import Reading, kind_of, span_of
from taskspec.text.data import Map, Text
from taskspec.text.units import Quantity

_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class Params(Kind):
    """The params, which are evaluated before anything else is read."""

    def read(self, value: object, reading: Reading) -> dict[str, Quantity]:
        """Return the evaluated params."""
        if not isinstance(value, Map):
            message = f"'params' is a mapping of names to quantities, this is {kind_of(value)}"
            reading.error("TS022", message, span_of(value), "params: {press: 15 N}")
        return dict(reading.params)

    def json(self) -> dict[str, Any]:
        """Describe the mapping."""
        return {"type": "object", "additionalProperties": {"type": ["string", "number"]}}


def evaluate_params(reading: Reading) -> None:
    """Evaluate all params, in whatever order they use each other, into `reading`."""
    data = reading.data.get("params")
    if not isinstance(data, Map):
        return
    known: dict[str, Quantity] = {}
    reading.params = known
    waiting = dict(data)
    while waiting:
        ready = [n for n, value in waiting.items() if not _uses(value) & waiting.keys()]
        if not ready:
            _report_circle(waiting, data, reading)
            ready = list(waiting)
            reading.broken |= frozenset(ready)
            return
        for name in ready:
            result = values.quantity(waiting.pop(name), reading)
            if result is None:
                reading.broken |= {name}
            else:
                known[name] = result
            reading.forget_scopes()


def _uses(value: object) -> set[str]:
    return set(_WORD.findall(value)) if isinstance(value, Text) else set()


def _report_circle(waiting: dict[str, object], data: Map, reading: Reading) -> None:
    """Report the params that use each other; those that only use such a one are left in peace."""
    step = next(iter(waiting))
    chain: list[str] = []
    while step not in chain:
        chain.append(step)
        step = sorted(_uses(waiting[step]) & waiting.keys())[0]
    circle = chain[chain.index(step) :]
    text = " uses ".join([*circle, circle[0]])
    reading.error("TS127", f"params define each other in a circle: {text}",
                  data.node.key_span(circle[0]), "give one of them a value of its own")  # fmt: skip
