"""Which sizes a shape has: shared by objects and tools."""

from __future__ import annotations

from collections.abc import Collection

from taskspec.shapes import size_keys
from taskspec.spec.model import complete
from taskspec.spec.parse_context import ParseContext
from taskspec.text.codes import register
from taskspec.text.data import Map
from taskspec.text.nodes import pointer

register(
    {
        "TS301": "a shape's size is missing",
        "TS302": "a size that the shape does not have",
    }
)


def check_sizes(
    shape: str, needed: Collection[str], allowed: Collection[str], data: Map, context: ParseContext
) -> None:
    """Reports sizes that a shape needs or does not have.

    Args:
        shape: its name.
        needed: keys of the sizes that it needs.
        allowed: keys of those that it can have.
        data: the mapping that holds the sizes.
        context: the pass.
    """
    sizes = size_keys()
    for key in sizes:
        if key in data and key not in allowed:
            has = f"its sizes: {', '.join(sorted(allowed))}" if allowed else "it has no size"
            name = data.node.as_written(key)
            context.error("TS302", f"a {shape} has no '{name}'", data.node.key_span(key), has)
    missing = [key for key in needed if key not in data]
    if missing and complete(data, context):
        span = data.node.key_span("shape") if "shape" in data else pointer(data.node)
        names = " and ".join(f"'{key}'" for key in missing)
        example = f"such as {missing[0]}: {sizes[missing[0]].example}"
        context.error("TS301", f"a {shape} needs {names}", span, example)
