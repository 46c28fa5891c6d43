"""Whether a condition can hold at all, by intervals and by what its parts say of one quantity."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from taskspec.expression import evaluate, tree
from taskspec.expression.tree import (
    Call,
    Compare,
    Held,
    Logic,
    Name,
    Negate,
    Node,
    Reduce,
    WithinNode,
)
from taskspec.program.interval import ANY, NEVER, Interval, IntervalAlgebra

Lookup = Callable[[Name], Interval]
Bounds = Mapping[Node, Interval]


def parts(node: Node) -> Iterator[Node]:
    """The conditions that all have to hold for a condition to hold."""
    waiting = [node]
    while waiting:
        current = waiting.pop(0)
        if isinstance(current, Logic) and current.op == "and":
            waiting = [*current.items, *waiting]
        else:
            yield current


def bounds_of(
    conditions: Iterable[Node], algebra: IntervalAlgebra, lookup: Lookup
) -> dict[Node, Interval]:
    """What conditions that all hold at once require of the quantities that they compare.

    Strict relations count as if they were not.
    """
    found: dict[Node, Interval] = {}

    def add(quantity: Node, interval: Interval) -> None:
        found[quantity] = found.get(quantity, ANY).meet(interval)
        match quantity:
            case Reduce("max", arg):
                add(arg, Interval(ANY.low, interval.high))
            case Reduce("min", arg):
                add(arg, Interval(interval.low, ANY.high))
            case Call("abs", (arg,)):
                add(arg, Interval(-interval.high, interval.high))
            case Negate(arg):
                add(arg, algebra.negate(interval))
            case _:
                pass

    for condition in conditions:
        for part in parts(condition):
            if isinstance(part, Compare):
                left = evaluate(part.left, algebra, lookup)
                right = evaluate(part.right, algebra, lookup)
                if part.op in (">", ">="):
                    add(part.left, Interval(right.low, ANY.high))
                    add(part.right, Interval(ANY.low, left.high))
                else:
                    add(part.left, Interval(ANY.low, right.high))
                    add(part.right, Interval(left.low, ANY.high))
            elif isinstance(part, WithinNode):
                low = evaluate(part.low, algebra, lookup).low
                add(part.x, Interval(low, evaluate(part.high, algebra, lookup).high))
    return found


def value_of(
    node: Node, algebra: IntervalAlgebra, lookup: Lookup, bounds: Bounds | None = None
) -> Interval:
    """Whether a condition never holds: its parts, and what is known, may exclude each other.

    That it always holds does not follow from the answer: parts are taken to hold for others.
    """
    inner = node.x if isinstance(node, Held) else node
    wanted = bounds_of([inner], algebra, lookup)
    known = dict(bounds or {})
    # What holds now says nothing of what a reducer has read.
    past = {n for reduced in tree.walk(node) if isinstance(reduced, Reduce) for n in names(reduced)}
    now = {name: interval for name, interval in wanted.items() if name not in past}

    def narrowed(name: Name) -> Interval:
        return lookup(name).meet(known.get(name, ANY)).meet(now.get(name, ANY))

    if any(narrowed(name).empty for name in names(node)):
        return NEVER
    for quantity, interval in wanted.items():
        within = evaluate(quantity, algebra, narrowed).meet(known.get(quantity, ANY))
        if within.meet(interval).empty:
            return NEVER
    return evaluate(node, algebra, narrowed)


def names(node: Node) -> Iterator[Name]:
    """The names in an expression, in the order in which they are written."""
    return (n for n in tree.walk(node) if isinstance(n, Name))
