"""Which sizes a shape has: shared by objects and tools."""

from __future__ import annotations

from collections.abc import Mapping

from taskspec.spec.model import complete
from taskspec.spec.reading import Reading
from taskspec.text.codes import register
from taskspec.text.data import Map
from taskspec.text.nodes import pointer

register(
    {
        "TS301": "a shape's size is missing",
        "TS302": "a size that the shape does not have",
    }
)

SIZES = ("radius", "size", "length")


def check_sizes(
    owner: str,
    shape: object,
    table: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]],
    data: Map,
    reading: Reading,
) -> None:
    """Report sizes that a shape needs or does not have.

    Args:
        owner: `object` or `tool`; a tool of every shape has a length.
        shape: the raw shape; anything that is not in the table is reported elsewhere.
        table: shape to (needed sizes, further sizes).
        data: the mapping that holds the sizes.
        reading: the pass.
    """
    if not isinstance(shape, str) or shape not in table:
        return
    needed, further = table[shape]
    allowed = {*needed, *further, *({"length"} if owner == "tool" else ())}
    for key in SIZES:
        if key in data and key not in allowed:
            has = f"its sizes: {', '.join(sorted(allowed))}" if allowed else "it has no size"
            reading.error("TS302", f"a {shape} has no '{key}'", data.node.key_span(key), has)
    missing = [key for key in needed if key not in data]
    if missing and complete(data, reading):
        span = data.node.key_span("shape") if "shape" in data else pointer(data.node)
        example = "[100 mm, 100 mm, 50 mm]" if missing[0] == "size" else "50 mm"
        names = " and ".join(f"'{key}'" for key in missing)
        reading.error("TS301", f"a {shape} needs {names}", span, f"such as {missing[0]}: {example}")
