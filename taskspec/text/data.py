"""Nodes as Python data that still knows its place: the input of the spec models.

Scalars follow the YAML 1.2 core schema: `1e3` is a number, `no` is a word.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

from taskspec.text import nodes
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics

register(
    {
        "TS011": "a key without a value",
        "TS015": "a number that is not finite",
    }
)

_INT = re.compile(r"[-+]?[0-9]+\Z")
_FLOAT = re.compile(r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?\Z")
_NOT_FINITE = re.compile(r"(?:[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN))\Z")
_NULL = ("", "~", "null", "Null", "NULL")
_TRUTH = {word: word[0] in "tT" for word in ("true", "True", "TRUE", "false", "False", "FALSE")}
MAX_DIGITS = 20
"""More digits than any quantity has."""


class Text(str):
    """A text."""

    __slots__ = ("node",)
    node: nodes.Scalar


class Whole(int):
    """A whole number without a unit."""

    node: nodes.Scalar


class Real(float):
    """A number without a unit."""

    __slots__ = ("node",)
    node: nodes.Scalar


class TruthValue:
    """`true` or `false`."""

    __slots__ = ("node", "value")

    def __init__(self, value: bool, node: nodes.Scalar) -> None:
        self.value = value
        self.node = node


class Items(list[object]):
    """A list."""

    __slots__ = ("node",)
    node: nodes.Sequence


class Map(dict[str, object]):
    """A mapping."""

    __slots__ = ("node",)
    node: nodes.Mapping


Leaf = Text | Whole | Real | TruthValue


def to_data(node: nodes.Node, diagnostics: Diagnostics) -> object | None:
    """A node as data; what has no usable value is reported and left out.

    A collection that something was left out of is marked as broken.
    """
    if isinstance(node, nodes.Scalar):
        return _leaf(node, diagnostics)
    if isinstance(node, nodes.Sequence):
        items = Items()
        items.node = node
        for item in node.items:
            _add(items.append, item, node, "an entry without a value", item, diagnostics)
        return items
    mapping = Map()
    mapping.node = node
    for name, (key, value) in node.entries.items():
        message = f"the key '{name}' has no value"
        _add(partial(mapping.__setitem__, name), value, node, message, key, diagnostics)
    return mapping


def _add(
    store: Callable[[object], None],
    node: nodes.Node,
    owner: nodes.Sequence | nodes.Mapping,
    no_value: str,
    place: nodes.Node,
    diagnostics: Diagnostics,
) -> None:
    if is_null(node):
        hint = "give it a value or leave it out"
        diagnostics.error("TS011", no_value, nodes.pointer(place), hint)
        owner.broken = True
        return
    value = to_data(node, diagnostics)
    if value is None:
        owner.broken = True
    else:
        store(value)


def is_null(node: nodes.Node) -> bool:
    """Whether a node says nothing."""
    return isinstance(node, nodes.Scalar) and node.plain and node.value in _NULL


def _leaf(node: nodes.Scalar, diagnostics: Diagnostics) -> Leaf | None:
    text = node.value
    if not node.plain or not text:
        return _placed(Text(text), node)
    if text in _TRUTH:
        return TruthValue(_TRUTH[text], node)
    if _NOT_FINITE.match(text):
        diagnostics.error("TS015", f"'{text}' is not a finite number", node.span)
        return None
    if _INT.match(text):
        if len(text.lstrip("+-")) > MAX_DIGITS:
            message = f"a number of more than {MAX_DIGITS} digits"
            diagnostics.error("TS015", message, node.span)
            return None
        return _placed(Whole(text), node)
    if _FLOAT.match(text):
        value = Real(text)
        if math.isinf(value):
            diagnostics.error("TS015", "this number is too large to be computed with", node.span)
            return None
        return _placed(value, node)
    return _placed(Text(text), node)


def text_of(node: nodes.Scalar) -> Text:
    """A scalar as a text."""
    return _placed(Text(node.value), node)


Placed = TypeVar("Placed", Text, Whole, Real)


def _placed(leaf: Placed, node: nodes.Scalar) -> Placed:
    leaf.node = node
    return leaf


def written(value: Any) -> str:
    """A value of an example as a file has it, in one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {written(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list):
        return f"[{', '.join(map(written, value))}]"
    return str(value).lower() if isinstance(value, bool) else str(value)
