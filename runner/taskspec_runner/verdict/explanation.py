"""What a verdict says: measured numbers in the units of the expectation, against their bounds."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, Scope, infer, tree
from taskspec.expression.series import NO_TICK, Series
from taskspec.text.units import NUMBER, fitting, in_unit, show, to_si
from taskspec_runner.verdict.judged import Broken, MeasuredValue
from taskspec_runner.verdict.quantities import DIGITS, digits_of, readable_unit

Vector = NDArray[np.float64]

#: A part of a condition and its value; the measured part comes first.
Sides = Sequence[tuple[tree.Node, Series]]

_FLIPPED = {"<": ">", "<=": ">=", ">": "<", ">=": "<="}
_GAPS_SHOWN = 3


@dataclass(frozen=True, slots=True)
class Explanation:
    """An explanation and the numbers in it."""

    text: str
    measured: tuple[MeasuredValue, ...] = ()


class Explainer:
    """Explains the conditions of one expectation.

    Args:
        expression: the expectation.
        scope: its names, for the dimensions of its parts.
        clock: (n,) the time of each tick [s].
    """

    def __init__(self, expression: Expression, scope: Scope, clock: Vector | None) -> None:
        self._expression, self._scope = expression, scope
        self._clock = np.zeros(0) if clock is None else clock

    def text(self, node: tree.Node) -> str:
        """A part of the expectation as it is written."""
        return " ".join(self._expression.text[node.start : node.end].split())

    def unknown(self, node: tree.Node, truth: Series) -> Explanation:
        """Why it is undecided whether a condition holds."""
        if truth.gaps:
            more = len(truth.gaps) - _GAPS_SHOWN
            rest = f"; and {more} more" if more > 0 else ""
            return Explanation("; ".join(truth.gaps[:_GAPS_SHOWN]) + rest)
        inside = truth.inside()
        if not len(inside):
            several = len({n.path[0] for n in tree.walk(node) if isinstance(n, tree.Name)}) > 1
            return Explanation("its stages have no tick in common" if several else NO_TICK)
        missing = int(np.count_nonzero(np.isnan(inside)))
        at = self._first(truth, np.isnan(truth.values))
        return Explanation(
            f"'{self.text(node)}' has no value at {missing} of {len(inside)} ticks{at}"
            if truth.window is not None
            else f"'{self.text(node)}' has no value"
        )

    def unknown_since(self, truth: Series, said: Explanation) -> tuple[Broken, ...]:
        """When it was first undecided whether a condition holds, if at some tick at all."""
        if truth.window is None:
            return ()
        rows = np.flatnonzero(truth.window & np.isnan(truth.values))
        return (Broken(self.clock(int(rows[0])), said.text),) if len(rows) else ()

    def clock(self, row: int) -> float:
        """The run time of a row [s]."""
        return float(self._clock[row])

    def share(self, node: tree.Held, truth: Series, sides: Sides) -> Explanation:
        """How often a condition holds, against how often it has to."""
        inside = truth.inside()
        share, needed = float(np.mean(inside)), node.amount.value_si
        # Rounded down, so that a share just missed does not read as one that is met.
        percent = math.floor(share * 1e4) / 100
        text = f"{percent:.4g} % of ticks (needs {100 * needed:.4g} %)"
        if share < needed and sides and truth.window is not None:
            text += f"; at worst {self._worst(node.x, truth, sides)}"
        return Explanation(
            text, (MeasuredValue(f"{self.text(node.x)}: share of ticks", percent, "%"),)
        )

    def number(self, node: tree.Node, passed: bool, sides: Sides) -> Explanation:
        """One number against its bounds."""
        if not sides:
            return Explanation("true" if passed else f"'{self.text(node)}' is false")
        part, series = sides[0]
        unit = self.unit(node, sides)
        name = self.text(part)
        measured = MeasuredValue(name, in_unit(series.number, unit), unit)
        digits = digits_of(series.number, [bound.number for _, bound in sides[1:]], unit)
        bounds = self._needs(node, sides, unit, 0, digits)
        return Explanation(f"{name} = {show(series.number, unit, digits)} ({bounds})", (measured,))

    def every_tick(self, node: tree.Node, truth: Series, sides: Sides) -> Explanation:
        """A condition that has to hold at every tick."""
        inside = truth.inside()
        held, ticks = int(np.count_nonzero(inside)), len(inside)
        passed = held == ticks
        if not sides:
            if passed:
                return Explanation("holds at every tick")
            broken = self._first(truth, truth.values != 1)
            return Explanation(f"does not hold at {ticks - held} of {ticks} ticks{broken}")
        part, series = sides[0]
        unit = self.unit(node, sides)
        if not passed:
            percent = math.floor(1e4 * held / ticks) / 100
            worst = self._worst(node, truth, sides)
            text = f"{percent:.4g} % of ticks (needs every tick); at worst {worst}"
        else:
            text = f"{self._range(node, truth, sides, unit)} at every tick"
            text += f" ({self._needs(node, sides, unit, None)})"
        values = np.broadcast_to(series.values, truth.values.shape)[truth.window]
        name = self.text(part)
        return Explanation(
            text,
            tuple(
                MeasuredValue(f"{which} {name}", in_unit(float(value), unit), unit)
                for which, value in (("lowest", values.min()), ("highest", values.max()))
            ),
        )

    def at(self, node: tree.Node, sides: Sides, row: int) -> str:
        """A measured part at a row, against its bounds there."""
        part, series = sides[0]
        unit, value = self.unit(node, sides), float(np.atleast_1d(series.values)[row])
        bounds = [float(b.values[0 if b.window is None else row]) for _, b in sides[1:]]
        digits = digits_of(value, bounds, unit)
        needs = self._needs(node, sides, unit, row, digits)
        return f"{self.text(part)} = {show(value, unit, digits)} ({needs})"

    def _range(self, node: tree.Node, truth: Series, sides: Sides, unit: str) -> str:
        series = sides[0][1]
        values = np.broadcast_to(series.values, truth.values.shape)[truth.window]
        low, high = show(float(values.min()), unit), show(float(values.max()), unit)
        if isinstance(node, tree.WithinNode):
            return f"{low} to {high}"
        return (
            f"at most {high}" if self.relation(node, sides).startswith("<") else f"at least {low}"
        )

    def _worst(self, node: tree.Node, truth: Series, sides: Sides) -> str:
        """The value that misses its bound by most, and when that was."""
        shape = truth.values.shape
        x, *bounds = (np.broadcast_to(series.values, shape) for _, series in sides)
        if isinstance(node, tree.WithinNode):
            excess = np.maximum(bounds[0] - x, x - bounds[1])
        else:
            excess = x - bounds[0]
            if not self.relation(node, sides).startswith("<"):
                excess = -excess
        assert truth.window is not None
        row = int(np.argmax(np.where(truth.window, excess, -np.inf)))
        unit = self.unit(node, sides)
        value = float(x[row])
        digits = digits_of(value, [float(bound[row]) for bound in bounds], unit)
        needs = self._needs(node, sides, unit, row, digits)
        return f"{show(value, unit, digits)} at {self._clock[row]:.4g} s ({needs})"

    def _needs(
        self, node: tree.Node, sides: Sides, unit: str, row: int | None, digits: int = DIGITS
    ) -> str:
        """The bounds, as they are at a row where they change with time."""
        bounds = [series for _, series in sides[1:]]
        if row is None and any(bound.window is not None for bound in bounds):
            return f"needs {self.relation(node, sides)} {self.text(sides[1][0])}"
        numbers = [
            show(float(b.values[row or 0] if b.window is not None else b.number), unit, digits)
            for b in bounds
        ]
        if isinstance(node, tree.WithinNode):
            return f"needs {numbers[0]} to {numbers[1]}"
        return f"needs {self.relation(node, sides)} {numbers[0]}"

    def relation(self, node: tree.Node, sides: Sides) -> str:
        """The relation, read from the measured side."""
        if not isinstance(node, tree.Compare):
            return "within"
        return node.op if sides[0][0] is node.left else _FLIPPED[node.op]

    def unit(self, condition: tree.Node, sides: Sides) -> str:
        """The largest unit that the bounds are written in, else the usual one."""
        part = sides[0][0]
        dimension = infer(part, self._scope)[0].dimension or NUMBER
        for nodes in ([bound for bound, _ in sides[1:]], [condition]):
            units = [
                number.unit
                for node in nodes
                for number in tree.walk(node)
                if isinstance(number, tree.Number) and number.dimension == dimension
            ]
            if any(units):
                unit = max(filter(None, units), key=lambda unit: to_si(1.0, unit).value)
                return readable_unit(unit, fitting(dimension), [bound for _, bound in sides[1:]])
        usual = fitting(dimension)
        return usual[0] if usual else ""

    def _first(self, truth: Series, mask: NDArray[np.bool_]) -> str:
        if truth.window is None:
            return ""
        rows = np.flatnonzero(truth.window & mask)
        return f", first at {self._clock[rows[0]]:.4g} s" if len(rows) else ""
