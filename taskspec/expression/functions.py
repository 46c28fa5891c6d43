"""The functions of the expression language and how their dimensions go."""

from __future__ import annotations

from typing import Literal

from taskspec.deferred_methods import dataclass

Rule = Literal["angle to number", "number to angle", "two to angle", "root", "number", "same",
               "to number", "two axes"]  # fmt: skip


@dataclass(frozen=True, slots=True)
class Function:
    """How many arguments a function takes, and how it treats dimensions.

    Attributes:
        fewest: the smallest number of arguments.
        most: the largest, None if there is none.
        rule: `same` requires one dimension of all arguments and returns it, `two axes` takes axes
            of frames, such as `tool.z`, instead of numbers.
    """

    fewest: int
    most: int | None
    rule: Rule


FUNCTIONS: dict[str, Function] = {
    "sin": Function(1, 1, "angle to number"),
    "cos": Function(1, 1, "angle to number"),
    "tan": Function(1, 1, "angle to number"),
    "asin": Function(1, 1, "number to angle"),
    "acos": Function(1, 1, "number to angle"),
    "atan": Function(1, 1, "number to angle"),
    "atan2": Function(2, 2, "two to angle"),
    "sqrt": Function(1, 1, "root"),
    "exp": Function(1, 1, "number"),
    "log": Function(1, 1, "number"),
    "smooth": Function(1, 1, "number"),
    "abs": Function(1, 1, "same"),
    "sign": Function(1, 1, "to number"),
    "min": Function(2, None, "same"),
    "max": Function(2, None, "same"),
    "clamp": Function(3, 3, "same"),
    "norm": Function(1, None, "same"),
    "angle": Function(2, 2, "two axes"),
}
"""`smooth(x)` rises from 0 at x <= 0 to 1 at x >= 1 as 6x^5 - 15x^4 + 10x^3; `clamp(x, a, b)`
keeps x between a and b; `norm` is the root of the sum of squares."""

REDUCERS = ("max", "min", "mean", "rms", "std", "last")
"""Functions of one argument over time; `max` and `min` of several arguments are functions."""
