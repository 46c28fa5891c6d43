"""Expressions over time: numbers with a value at every tick of a run, or of what is predicted.

A condition is 1, 0 or NaN. NaN means that it is undecided, because something in it has no value
at that tick; `and`, `or` and `not` pass it on unless the other items decide alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression import tree

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

NO_TICK = "there is no tick to judge"


@dataclass(frozen=True, slots=True)
class Series:
    """A quantity over a run, or one number.

    Attributes:
        values: (n,) at every tick of the run; (1,) of one number.
        window: (n,) the ticks that count; None for one number.
        gaps: why it has no value where it is NaN, or no tick at all.
    """

    values: Vector
    window: Mask | None = None
    gaps: tuple[str, ...] = ()

    @classmethod
    def one(cls, value: float, gaps: tuple[str, ...] = ()) -> Series:
        """One number."""
        return cls(np.array([value], dtype=float), None, gaps)

    def inside(self) -> Vector:
        """The values that count, in order."""
        return self.values if self.window is None else self.values[self.window]

    @property
    def number(self) -> float:
        """The value of one number."""
        return float(self.values[0])

    @property
    def known(self) -> bool:
        """Whether there is a tick, and a value at every tick."""
        inside = self.inside()
        return len(inside) > 0 and not bool(np.isnan(inside).any())


def combine(function: Callable[..., Vector], *parts: Series) -> Series:
    """A function of several series, tick by tick, over the ticks that they have in common."""
    with np.errstate(all="ignore"):
        # Of a long run these are arrays in files, of a class of their own, which stay so.
        values = np.asanyarray(function(*(p.values for p in parts)), dtype=float)
    windows = [p.window for p in parts if p.window is not None]
    window = reduce(np.logical_and, windows) if windows else None
    gaps = tuple(dict.fromkeys(gap for p in parts for gap in p.gaps))
    return Series(np.where(np.isfinite(values), values, np.nan), window, gaps)


class SeriesAlgebra:
    """The operations of the expression language on series."""

    def number(self, value: float) -> Series:
        """Return a constant."""
        return Series.one(value)

    def binary(self, op: tree.BinaryOp, left: Series, right: Series) -> Series:
        """Return left op right."""
        return combine(_BINARY[op], left, right)

    def negate(self, x: Series) -> Series:
        """Return -x."""
        return combine(np.negative, x)

    def power(self, base: Series, exponent: float) -> Series:
        """Return base ^ exponent."""
        return combine(lambda x: np.power(x, exponent), base)

    def call(self, function: str, args: Sequence[Series]) -> Series:
        """Return a function of the language."""
        return combine(_FUNCTIONS[function], *args)

    def compare(self, op: tree.CompareOp, left: Series, right: Series) -> Series:
        """Return whether left op right."""
        relation = _COMPARE[op]
        return combine(
            lambda a, b: np.where(np.isnan(a) | np.isnan(b), np.nan, relation(a, b)), left, right
        )

    def logic(self, op: Literal["and", "or"], items: Sequence[Series]) -> Series:
        """Return whether all of the items hold, or any."""
        return combine(_all if op == "and" else _any, *items)

    def invert(self, x: Series) -> Series:
        """Return not x."""
        return combine(lambda v: 1 - v, x)

    def held(self, node: tree.Held, x: Series, amount: float) -> Series:  # noqa: ARG002
        """Return whether x holds in the share `amount` of its ticks."""
        if not x.known:
            return Series.one(np.nan, x.gaps or (NO_TICK,))
        inside = x.inside()
        # A share is counted: 0.93 of 1000 ticks are 930 of them in spite of rounding.
        return Series.one(float(np.count_nonzero(inside) >= amount * len(inside) * (1 - 1e-12)))

    def reduce(self, node: tree.Reduce, reducer: str, x: Series) -> Series:  # noqa: ARG002
        """Return one number from the ticks that count."""
        if not x.known:
            return Series.one(np.nan, x.gaps or (NO_TICK,))
        return Series.one(float(_REDUCERS[reducer](x.inside())), x.gaps)


def _all(*items: Vector) -> Vector:
    unknown = np.where(reduce(np.logical_or, map(np.isnan, items)), np.nan, 1.0)
    return np.where(reduce(np.logical_or, (each == 0 for each in items)), 0.0, unknown)


def _any(*items: Vector) -> Vector:
    return 1 - _all(*(1 - item for item in items))


def _smooth(x: Vector) -> Vector:
    u = np.clip(x, 0.0, 1.0)
    return u**3 * (10.0 + u * (6.0 * u - 15.0))


_BINARY: dict[str, Callable[..., Vector]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
}
_COMPARE: dict[str, Callable[..., Mask]] = {
    "<": np.less,
    "<=": np.less_equal,
    ">": np.greater,
    ">=": np.greater_equal,
}
_REDUCERS: dict[str, Callable[[Vector], float]] = {
    "max": lambda x: float(np.max(x)),
    "min": lambda x: float(np.min(x)),
    "mean": lambda x: float(np.mean(x)),
    "rms": lambda x: float(np.sqrt(np.mean(x**2))),
    "std": lambda x: float(np.std(x)),
    "last": lambda x: float(x[-1]),
}
_FUNCTIONS: dict[str, Callable[..., Vector]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "atan2": np.arctan2,
    "sqrt": np.sqrt,
    "exp": np.exp,
    "log": np.log,
    "abs": np.abs,
    "sign": np.sign,
    "min": lambda *x: reduce(np.minimum, x),
    "max": lambda *x: reduce(np.maximum, x),
    "clamp": lambda x, low, high: np.minimum(np.maximum(x, low), high),
    "smooth": _smooth,
    "norm": lambda *x: np.sqrt(sum(v**2 for v in x)),
}
