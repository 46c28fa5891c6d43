"""Expressions of the task file as CasADi expressions, with memory where a guard needs the past."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np

from taskspec.expression import Expression, evaluate
from taskspec.expression.tree import BinaryOp, CompareOp, Held, Name, Reduce
from taskspec.program.slots import Slots

_BINARY = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}
_COMPARE = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}

_FUNCTIONS: dict[str, Callable[..., ca.SX]] = {
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "asin": ca.asin,
    "acos": ca.acos,
    "atan": ca.atan,
    "atan2": ca.atan2,
    "sqrt": ca.sqrt,
    "exp": ca.exp,
    "log": ca.log,
    "abs": ca.fabs,
    "sign": ca.sign,
    "min": lambda *x: _fold(ca.fmin, x),
    "max": lambda *x: _fold(ca.fmax, x),
    "clamp": lambda x, low, high: ca.fmin(ca.fmax(x, low), high),
    "smooth": lambda x: _smooth(ca.fmin(ca.fmax(x, 0), 1)),
    "norm": lambda *x: length(ca.vertcat(*x)),
    "angle": lambda a, b: ca.atan2(length(ca.cross(a, b)), ca.dot(a, b)),
}


def length(x: ca.SX) -> ca.SX:
    """|x|, whose rate is 0 where x is 0: the root alone would have none there."""
    squares = ca.sumsqr(x)
    nothing = squares == 0
    return ca.sqrt(squares + nothing) - nothing


def _smooth(x: ca.SX) -> ca.SX:
    return x**3 * (10 - x * (15 - 6 * x))


def _fold(function: Callable[[ca.SX, ca.SX], ca.SX], values: Sequence[ca.SX]) -> ca.SX:
    result = values[0]
    for value in values[1:]:
        result = function(result, value)
    return result


class CasadiAlgebra:
    """Numbers of the expression language as SX; `Held` and reducers live in the stage's memory.

    Args:
        memory: where reducers and timers take slots; None where an expression may have no past.
        period: control period [s].
    """

    def __init__(self, memory: Slots | None, period: float) -> None:
        self._memory = memory
        self.period = period
        #: Slot name to its value after this tick, and to its value before the first one.
        self.updates: dict[str, ca.SX] = {}
        self.initial: dict[str, float] = {}

    def translate(self, expression: Expression, lookup: Callable[[Name], ca.SX]) -> ca.SX:
        """The expression as SX; truth values are 0 or 1."""
        return ca.SX(evaluate(expression.tree, self, lookup))

    def number(self, value: float) -> ca.SX:
        """A constant."""
        return ca.SX(value)

    def binary(self, op: BinaryOp, left: ca.SX, right: ca.SX) -> ca.SX:
        """Left op right."""
        return _BINARY[op](left, right)

    def negate(self, x: ca.SX) -> ca.SX:
        """-x."""
        return -x

    def power(self, base: ca.SX, exponent: float) -> ca.SX:
        """Base ^ exponent."""
        return base**exponent

    def call(self, function: str, args: Sequence[ca.SX]) -> ca.SX:
        """A function of the language."""
        return _FUNCTIONS[function](*args)

    def compare(self, op: CompareOp, left: ca.SX, right: ca.SX) -> ca.SX:
        """Whether left op right."""
        return _COMPARE[op](left, right)

    def logic(self, op: str, items: Sequence[ca.SX]) -> ca.SX:
        """Whether all of the items hold, or any."""
        return _fold(ca.logic_and if op == "and" else ca.logic_or, items)

    def invert(self, x: ca.SX) -> ca.SX:
        """Not x."""
        return ca.logic_not(x)

    def held(self, _node: Held, value: ca.SX, amount: float) -> ca.SX:
        """Whether `value` has been true for `amount` seconds without a break."""
        elapsed = self._slot("held", -1.0)
        since = ca.if_else(elapsed < 0, 0, elapsed + self.period)
        now = ca.if_else(value, since, -1)
        self.updates[self._last] = now
        return now >= amount - self.period / 2

    def reduce(self, _node: Reduce, reducer: str, value: ca.SX) -> ca.SX:
        """The reducer over the stage so far, this tick included."""
        if reducer == "last":
            return value
        if reducer in ("min", "max"):
            extreme = self._slot(reducer, np.inf if reducer == "min" else -np.inf)
            function = ca.fmin if reducer == "min" else ca.fmax
            result = function(extreme, value)
            self.updates[self._last] = result
            return result
        count = self._accumulate(ca.SX(1))
        mean = self._accumulate(value) / count
        if reducer == "mean":
            return mean
        square = self._accumulate(value**2) / count
        if reducer == "rms":
            return ca.sqrt(square)
        return ca.sqrt(ca.fmax(square - mean**2, 0))

    def _accumulate(self, value: ca.SX) -> ca.SX:
        total = self._slot("sum", 0.0) + value
        self.updates[self._last] = total
        return total

    def _slot(self, kind: str, initial: float) -> ca.SX:
        assert self._memory is not None
        self._last = f"guard.{kind}.{len(self.initial)}"
        self.initial[self._last] = initial
        return self._memory.add(self._last)


def constants(params: Mapping[str, float]) -> dict[str, ca.SX]:
    """Params and pi by name."""
    return {"pi": ca.SX(np.pi)} | {name: ca.SX(value) for name, value in params.items()}
