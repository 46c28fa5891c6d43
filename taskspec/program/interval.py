"""Expressions over intervals: which values they can take while signals stay within bounds.

Every operation returns an interval that holds all values which numbers of its arguments' intervals
make, so that a condition whose interval is [0, 0] never holds. What has no value for some of them
is unbounded.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Literal

from taskspec.deferred_methods import dataclass
from taskspec.expression import FloatAlgebra, tree


@dataclass(frozen=True, slots=True)
class Interval:
    """From `low` to `high`, both included; a condition is 0 (never), 1 (always) or [0, 1]."""

    low: float
    high: float

    @property
    def never(self) -> bool:
        """Whether a condition holds for none of the values."""
        return self.high <= 0.0

    @property
    def always(self) -> bool:
        """Whether a condition holds for all of the values."""
        return self.low > 0.0

    @property
    def size(self) -> float:
        """The largest magnitude."""
        return max(abs(self.low), abs(self.high))

    @property
    def empty(self) -> bool:
        """Whether it holds no value."""
        return self.low > self.high

    def meet(self, other: Interval) -> Interval:
        """The intersection; its ends are reversed where it is empty."""
        return Interval(max(self.low, other.low), min(self.high, other.high))


ANY = Interval(-math.inf, math.inf)
MAYBE = Interval(0.0, 1.0)
NEVER = Interval(0.0, 0.0)
ALWAYS = Interval(1.0, 1.0)
_FLOAT = FloatAlgebra()
#: Functions that never fall.
_RISING = ("asin", "atan", "sqrt", "exp", "log", "sign", "smooth")
_RANGES = {
    "sin": Interval(-1.0, 1.0),
    "cos": Interval(-1.0, 1.0),
    "acos": Interval(0.0, math.pi),
    "atan2": Interval(-math.pi, math.pi),
}


def point(value: float) -> Interval:
    """One number; anything, where it is none."""
    return Interval(value, value) if math.isfinite(value) else ANY


def hull(values: Sequence[float]) -> Interval:
    """The least interval with all values; anything, where one of them is no number."""
    return ANY if any(map(math.isnan, values)) else Interval(min(values), max(values))


class IntervalAlgebra:
    """The operations of expressions on intervals.

    Args:
        longest: how long the stage lasts at most [s]; a condition that has to hold for longer does
            not. Infinite where nothing says it.
    """

    def __init__(self, longest: float = math.inf) -> None:
        self._longest = longest

    def number(self, value: float) -> Interval:
        """The constant alone."""
        return point(value)

    def binary(self, op: tree.BinaryOp, left: Interval, right: Interval) -> Interval:
        """Left op right; a quotient by what may be zero is unbounded."""
        if op == "/":
            if right.low <= 0.0 <= right.high:
                return ANY
            return hull([a / b for a in (left.low, left.high) for b in (right.low, right.high)])
        if op == "*":
            ends = [(a, b) for a in (left.low, left.high) for b in (right.low, right.high)]
            return hull([0.0 if 0.0 in (a, b) else a * b for a, b in ends])
        other = right if op == "+" else self.negate(right)
        return hull([left.low + other.low, left.high + other.high])

    def negate(self, x: Interval) -> Interval:
        """-x."""
        return Interval(-x.high, -x.low)

    def power(self, base: Interval, exponent: float) -> Interval:
        """Base ^ exponent for whole exponents, and for others of what is not negative."""
        whole = exponent == round(exponent)
        if exponent < 0:
            return self.binary("/", ALWAYS, self.power(base, -exponent))
        if not whole and base.low < 0:
            return ANY
        ends = [_power(base.low, exponent), _power(base.high, exponent)]
        if whole and exponent % 2 == 0 and base.low < 0 < base.high:
            ends.append(0.0)
        return hull(ends)

    def call(self, function: str, args: Sequence[Interval]) -> Interval:
        """A function's values."""
        first = args[0]
        # The sign of a zero decides where atan2 is, and it is not known.
        if all(a.low == a.high for a in args) and not (function == "atan2" and first.low == 0.0):
            return point(_FLOAT.call(function, [a.low for a in args]))
        if function in _RISING:
            return hull([_at(function, first.low), _at(function, first.high)])
        if function == "abs":
            return _magnitude(first)
        if function in ("min", "max"):
            pick: Callable[..., float] = min if function == "min" else max
            return Interval(pick(a.low for a in args), pick(a.high for a in args))
        if function == "clamp":
            _, low, high = args
            return Interval(
                min(max(first.low, low.low), high.low), min(max(first.high, low.high), high.high)
            )
        if function == "norm":
            parts = [_magnitude(a) for a in args]
            return Interval(
                math.hypot(*(a.low for a in parts)), math.hypot(*(a.high for a in parts))
            )
        return _RANGES.get(function, ANY)

    def compare(self, op: tree.CompareOp, left: Interval, right: Interval) -> Interval:
        """Whether left op right: never, always or maybe."""
        if op in (">", ">="):
            return self.compare("<" if op == ">" else "<=", right, left)
        if op == "<":
            surely, ever = left.high < right.low, left.low < right.high
        else:
            surely, ever = left.high <= right.low, left.low <= right.high
        return ALWAYS if surely else MAYBE if ever else NEVER

    def logic(self, op: Literal["and", "or"], items: Sequence[Interval]) -> Interval:
        """Whether all of the items hold, or any."""
        pick: Callable[..., float] = min if op == "and" else max
        return Interval(pick(i.low for i in items), pick(i.high for i in items))

    def invert(self, x: Interval) -> Interval:
        """Not x."""
        return Interval(1.0 - x.high, 1.0 - x.low)

    def held(self, node: tree.Held, x: Interval, amount: float) -> Interval:  # noqa: ARG002
        """Whether x can hold for `amount`, a time [s] of guards."""
        return NEVER if amount > self._longest else Interval(0.0, x.high)

    def reduce(self, node: tree.Reduce, reducer: str, x: Interval) -> Interval:  # noqa: ARG002
        """One number from a history of values that all lie in x."""
        if reducer == "rms":
            return _magnitude(x)
        if reducer == "std":
            return Interval(0.0, (x.high - x.low) / 2)
        return x


def _magnitude(x: Interval) -> Interval:
    low = 0.0 if x.low <= 0.0 <= x.high else min(abs(x.low), abs(x.high))
    return Interval(low, x.size)


def _at(function: str, x: float) -> float:
    if math.isinf(x):
        ends = {"atan": math.copysign(math.pi / 2, x), "sign": math.copysign(1.0, x)}
        ends |= {"exp": 0.0 if x < 0 else x, "smooth": float(x > 0)}
        return ends.get(function, x)
    return _FLOAT.call(function, [x])


def _power(base: float, exponent: float) -> float:
    if math.isinf(base):
        return 1.0 if exponent == 0 else base if base > 0 or exponent % 2 else -base
    return _FLOAT.power(base, exponent)
