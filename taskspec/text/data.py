"""Nodes as Python data that still knows its place: the input of the spec models.

Scalars follow the YAML 1.2 core schema: `1e3` is a number, `no` is a word.
"""

from __future__ import annotations

import re

from taskspec.text import nodes
from taskspec.text.diagnostic import Diagnostics

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


class Truth:
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


Leaf = Text | Whole | Real | Truth


def to_data(node: nodes.Node, diagnostics: Diagnostics) -> object:
    """Return a node as data; what has no value is reported and left out."""
    if isinstance(node, nodes.Scalar):
        return _leaf(node, diagnostics)
    if isinstance(node, nodes.Sequence):
        items = Items()
        items.node = node
        for item in node.items:
            if is_null(item):
                diagnostics.error("TS011", "an entry without a value", nodes.pointer(item))
                node.broken = True
            else:
                items.append(to_data(item, diagnostics))
        return items
    mapping = Map()
    mapping.node = node
    for name, (key, value) in node.entries.items():
        if is_null(value):
            diagnostics.error(
                "TS011",
                f"the key '{name}' has no value",
                key.span,
                "give it a value or leave it out",
            )
            node.broken = True
        else:
            mapping[name] = to_data(value, diagnostics)
    return mapping


def is_null(node: nodes.Node) -> bool:
    """Whether a node says nothing."""
    return isinstance(node, nodes.Scalar) and node.plain and node.value in _NULL


def _leaf(node: nodes.Scalar, diagnostics: Diagnostics) -> Leaf:
    text = node.value
    if node.plain and text:
        if text in _TRUTH:
            return Truth(_TRUTH[text], node)
        if _NOT_FINITE.match(text):
            diagnostics.error("TS015", f"'{text}' is not a finite number", node.span)
            return _real(0.0, node)
        if _INT.match(text):
            return _whole(text, node, diagnostics)
        if _FLOAT.match(text):
            value = float(text)
            if value in (float("inf"), float("-inf")):
                diagnostics.error("TS015", "this number is too large", node.span)
                value = 0.0
            return _real(value, node)
    word = Text(text)
    word.node = node
    return word


def _whole(text: str, node: nodes.Scalar, diagnostics: Diagnostics) -> Whole:
    if len(text.lstrip("+-")) > MAX_DIGITS:
        diagnostics.error("TS015", f"a number of more than {MAX_DIGITS} digits", node.span)
        text = "0"
    number = Whole(text)
    number.node = node
    return number


def _real(value: float, node: nodes.Scalar) -> Real:
    number = Real(value)
    number.node = node
    return number
