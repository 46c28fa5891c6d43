"""The nodes of a parsed expression. Each knows where in the text it stands."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import field
from typing import Literal

from taskspec.deferred_methods import dataclass
from taskspec.text.units import Dimension

CompareOp = Literal["<", "<=", ">", ">="]
BinaryOp = Literal["+", "-", "*", "/"]


@dataclass(frozen=True, slots=True)
class Node:
    """A node; `start` and `end` are character offsets inside the expression, end exclusive."""

    start: int = field(default=0, kw_only=True, compare=False, repr=False)
    end: int = field(default=0, kw_only=True, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Number(Node):
    """A number in SI units; `unit` is the unit as written, empty if there was none."""

    value_si: float
    dimension: Dimension
    unit: str = field(default="", kw_only=True)


@dataclass(frozen=True, slots=True)
class Name(Node):
    """A param, a constant or a signal, such as `wipe.force.z`, resolved in `frame` if given."""

    path: tuple[str, ...]
    frame: str | None = None

    def __str__(self) -> str:
        return ".".join(self.path) + (f" in {self.frame}" if self.frame else "")


@dataclass(frozen=True, slots=True)
class Negate(Node):
    """-x."""

    x: Node


@dataclass(frozen=True, slots=True)
class Binary(Node):
    """left op right."""

    op: BinaryOp
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class Power(Node):
    """base ^ exponent, the exponent a plain number."""

    base: Node
    exponent: float


@dataclass(frozen=True, slots=True)
class Call(Node):
    """A function of its arguments."""

    function: str
    args: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Reduce(Node):
    """One number from the history of `arg`: over the stage so far, or over a window of the run."""

    reducer: str
    arg: Node


@dataclass(frozen=True, slots=True)
class Compare(Node):
    """left op right, true or false."""

    op: CompareOp
    left: Node
    right: Node


@dataclass(frozen=True, slots=True)
class WithinNode(Node):
    """low <= x <= high; from `x within a..b` or `x within a +- b`."""

    x: Node
    low: Node
    high: Node


@dataclass(frozen=True, slots=True)
class Not(Node):
    """Not x."""

    x: Node


@dataclass(frozen=True, slots=True)
class Logic(Node):
    """All of the items, or any of them."""

    op: Literal["and", "or"]
    items: tuple[Node, ...]


@dataclass(frozen=True, slots=True)
class Held(Node):
    """X without a break for a time [s], or for a share (0..1) of all ticks."""

    x: Node
    amount: Number


@dataclass(frozen=True, slots=True)
class IntervalNode(Node):
    """From `low` to `high`."""

    low: Node
    high: Node


@dataclass(frozen=True, slots=True)
class SpreadNode(Node):
    """Plus or minus x about a nominal value that stands elsewhere."""

    x: Node


@dataclass(frozen=True, slots=True)
class Equation(Node):
    """left op right, as a constraint."""

    op: Literal["=", "<=", ">="]
    left: Node
    right: Node


def about(low: Node, high: Node) -> tuple[Node, Node] | None:
    """The a and the b that `a +- b` was written with; None of an interval with two ends."""
    match low, high:
        case Binary("-", middle, half), Binary("+", above, other):
            same = (middle, half) == (above, other) and half.start == other.start
            return (middle, half) if same else None
        case _:
            return None


def is_share(node: Node) -> bool:
    """Whether a node is a percentage and nothing else, such as the 5 % of `12 N +- 5 %`."""
    number = node.x if isinstance(node, Negate) else node
    return isinstance(number, Number) and number.unit == "%"


def children(node: Node) -> tuple[Node, ...]:
    """The nodes directly below a node, in the order in which they are written."""
    match node:
        case Negate(x) | Not(x) | SpreadNode(x):
            return (x,)
        case Binary(_, left, right) | Compare(_, left, right) | Equation(_, left, right):
            return (left, right)
        case Power(base, _):
            return (base,)
        case Call(_, args):
            return args
        case Reduce(_, arg):
            return (arg,)
        case WithinNode(x, low, high):
            return (x, low, high)
        case Logic(_, items):
            return items
        case Held(x, amount):
            return (x, amount)
        case IntervalNode(low, high):
            return (low, high)
        case _:
            return ()


def walk(node: Node) -> Iterator[Node]:
    """A node and everything below it, without recursion."""
    waiting = [node]
    while waiting:
        current = waiting.pop()
        yield current
        waiting.extend(reversed(children(current)))
