"""The types that parts of an expression have."""

from __future__ import annotations

from typing import Literal

from taskspec.deferred_methods import dataclass
from taskspec.expression import tree
from taskspec.text.units import NUMBER, TIME, Dimension, describe


@dataclass(frozen=True, slots=True)
class Type:
    """What a node is: a number of some dimension, a condition, or three numbers.

    `unknown` is the type of what is already reported; it fits everything. A number without a
    dimension is a bare zero, which fits every dimension.
    """

    kind: Literal["number", "condition", "vector", "unknown"]
    dimension: Dimension | None = None


CONDITION = Type("condition")
UNKNOWN = Type("unknown")
ZERO = Type("number", None)
PLAIN = Type("number", NUMBER)


def ends(low: tree.Node, high: tree.Node) -> list[tree.Node]:
    """What an interval was written with: a +- b is held as a - b and a + b."""
    return list(tree.about(low, high) or (low, high))


def is_bare(node: tree.Node) -> bool:
    """Whether a node is a number without a unit, or a power of one."""
    number = node.x if isinstance(node, tree.Negate) else node
    number = number.base if isinstance(number, tree.Power) else number
    return isinstance(number, tree.Number) and not number.unit


def in_words(kind: Type) -> str:
    """A number's dimension in words."""
    return describe(kind.dimension) if kind.dimension is not None else "zero"


def example_axis(node: tree.Node) -> str:
    """An axis to show as an example for a signal without one."""
    return "rz" if isinstance(node, tree.Name) and node.path[-1] == "torque" else "z"


def cycle_hint(kind: Type) -> str:
    """What to do about a time in a sine."""
    return "divide by the period: sin(2*pi*t/(4 s))" if kind.dimension == TIME else ""
