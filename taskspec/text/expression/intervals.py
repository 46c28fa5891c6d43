"""Intervals after `within` that hold nothing: ends the wrong way round, or one and the same."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from taskspec.signals import STAGE
from taskspec.text.codes import register
from taskspec.text.expression import tree
from taskspec.text.expression.evaluate import FloatAlgebra, evaluate
from taskspec.text.expression.problem import Problem

register({"TS711": "an interval whose ends are the wrong way round"})


def interval_problems(root: tree.Node, lookup: Callable[[tree.Name], float]) -> Iterator[Problem]:
    """Says which intervals of a condition no measured number lies in.

    Args:
        root: a checked tree.
        lookup: the value of a param in SI units; nan of any other name.
    """
    for node in tree.walk(root):
        if not isinstance(node, tree.WithinNode):
            continue
        low, high = (evaluate(end, FloatAlgebra(), lookup) for end in (node.low, node.high))
        begin, end = node.low.start, node.high.end
        half = _half(node)
        if half is not None:
            begin, end = half.start, half.end
        if low > high and half is not None:
            yield Problem("TS711", "a tolerance below zero", begin, end, "leave out its sign")
        elif low > high:
            message = "this interval ends before it begins"
            yield Problem("TS711", message, begin, end, "write the smaller value first")
        elif low == high != 0 and math.isfinite(low) and not _counts(node.x):
            message = "an interval of no width is an equality, which no measured number meets"
            yield Problem("TS103", message, begin, end, "give it a width, such as +- 2 % of it")


def _half(node: tree.WithinNode) -> tree.Node | None:
    """The x of `within a +- x`; None of an interval with two ends."""
    match node.low, node.high:
        case tree.Binary("-", first, below), tree.Binary("+", second, above):
            same = below == above and (below.start, below.end) == (above.start, above.end)
            return below if same and first == second else None
        case _:
            return None


def _counts(x: tree.Node) -> bool:
    """Whether a value is made of a signal that is counted, so that one number can be met."""
    counted = {name for name, signal in STAGE.items() if signal.counted}
    return any(isinstance(n, tree.Name) and n.path[-1] in counted for n in tree.walk(x))
