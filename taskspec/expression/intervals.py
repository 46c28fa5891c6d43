"""Intervals that hold nothing, or not what was meant: ends the wrong way round, shares."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from taskspec.expression import tree
from taskspec.expression.evaluate import FloatAlgebra, evaluate
from taskspec.expression.problem import Problem
from taskspec.signals import STAGE
from taskspec.text.codes import register

register(
    {
        "TS106": "a tolerance in percent of 0, or of a plain number",
        "TS711": "an interval whose ends are the wrong way round",
    }
)

Lookup = Callable[[tree.Name], float]


def interval_problems(root: tree.Node, lookup: Lookup) -> Iterator[Problem]:
    """Says which intervals of a condition no measured number lies in, or only by a slip.

    Args:
        root: a checked tree.
        lookup: the value of a param in SI units; nan of any other name.
    """
    for node in tree.walk(root):
        if not isinstance(node, tree.WithinNode):
            continue
        low, high = (evaluate(end, FloatAlgebra(), lookup) for end in (node.low, node.high))
        begin, end = node.low.start, node.high.end
        parts = tree.about(node.low, node.high)
        if parts is not None:
            begin, end = parts[1].start, parts[1].end
        if low > high and parts is not None:
            yield Problem("TS711", "a tolerance below zero", begin, end, "leave out its sign")
        elif low > high:
            message = "this interval ends before it begins"
            yield Problem("TS711", message, begin, end, "write the smaller value first")
        elif low == high != 0 and math.isfinite(low) and not _counts(node.x):
            message = "an interval of no width is an equality, which no measured number meets"
            yield Problem("TS103", message, begin, end, "give it a width, such as +- 2 % of it")
        else:
            yield from share_problems(node.low, node.high, lookup)


def share_problems(low: tree.Node, high: tree.Node, lookup: Lookup) -> Iterator[Problem]:
    """Says what is wrong with the percentage of `a +- 5 %`: a is 0, or a plain number.

    Args:
        low, high: the ends of a checked interval.
        lookup: as in `interval_problems`.
    """
    parts = tree.about(low, high)
    if parts is None:
        return
    middle, half = parts
    value = evaluate(middle, FloatAlgebra(), lookup)
    if value == 0 and _is_relative(half, middle):
        yield share_of_zero(half)
    # A share of 1 is the same either way; of 0 and beside another percentage none is meant.
    elif tree.is_share(half) and not tree.is_share(middle) and abs(value) not in (0.0, 1.0):
        yield share_of_a_number(half, f"{abs(value):g}" if math.isfinite(value) else "value")


def share_of_zero(half: tree.Node) -> Problem:
    """Reports a percentage of 0."""
    message = "a percentage of 0 is a tolerance of no width"
    hint = "write the width itself, with its unit"
    return Problem("TS106", message, half.start, half.end, hint)


def share_of_a_number(half: tree.Node, value: str = "") -> Problem:
    """Warns of a percentage about a plain number, `value`, or one that stands elsewhere."""
    width = evaluate(half, FloatAlgebra(), lambda _: math.nan)
    percent = f"{100 * width:g} %"
    of, other = ("it", f"+- {percent} * {value}") if value else ("it in the file", "a..b")
    message = f"this is {width:g} to either side, not {percent} of the value"
    hint = f"write +- {width:g}, or for a share of {of} {other}"
    return Problem("TS106", message, half.start, half.end, hint, warning=True)


def _is_relative(half: tree.Node, middle: tree.Node) -> bool:
    """Whether the b of `a +- b` is a share of a, as a checked tree has it."""
    match half:
        case tree.Binary("*", share, tree.Call("abs", (of,))):
            return tree.is_share(share) and of == middle
        case _:
            return False


def _counts(x: tree.Node) -> bool:
    """Whether a value is made of a signal that is counted, so that one number can be met."""
    counted = {name for name, signal in STAGE.items() if signal.counted}
    return any(isinstance(n, tree.Name) and n.path[-1] in counted for n in tree.walk(x))
