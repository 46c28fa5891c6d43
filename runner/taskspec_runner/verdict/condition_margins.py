"""The margins and the breaks of one condition of an expectation, in its own units."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from taskspec.expression import tree
from taskspec.expression.series import Series
from taskspec.text.units import in_unit
from taskspec_runner.verdict.explanation import Explainer, Sides
from taskspec_runner.verdict.judged import SHARE, Broken, Margin
from taskspec_runner.verdict.margin import Vector, left, lost_share, reached, room

Bounds = tuple[Vector | None, Vector | None]
_ONE = Series.one(np.nan)


class ConditionMargins:
    """One condition, without the `for` that it may have.

    Args:
        say: the words of its expectation.
        value: of any part of it.
        condition: itself.
        sides: its measured part and its bounds.
    """

    def __init__(
        self,
        say: Explainer,
        value: Callable[[tree.Node], Series],
        condition: tree.Node,
        sides: Sides,
    ) -> None:
        self._say, self._value, self._condition, self._sides = say, value, condition, sides

    def margins(self, node: tree.Node, truth: Series) -> Iterator[Margin]:
        """How far inside its bounds the condition stayed, at the tick where it came nearest.

        Args:
            node: the condition with its `for`.
            truth: of the condition, tick by tick.
        """
        if isinstance(node, tree.Held):
            share, needed = float(np.mean(truth.inside())), node.amount.value_si
            unused = (share - needed) / (1 - needed) if needed < 1 else None
            yield Margin(SHARE, 100 * (share - needed), "%", unused)
        elif self._sides:
            values, (low, high) = self._numbers(truth)
            distance = room(values, low, high)
            row = int(np.argmin(distance))
            sides = [None if side is None else float(side[row]) for side in (low, high)]
            unit = self._say.unit(self._condition, self._sides)
            yield Margin(
                self._say.text(self._sides[0][0]),
                in_unit(float(distance[row]), unit),
                unit,
                left(float(distance[row]), *sides),
            )

    def breaks(self, node: tree.Node, truth: Series) -> Iterator[Broken]:
        """When a condition that was missed was broken for good, where a tick did it."""
        if truth.window is None:
            yield from self._number()
            return
        bad = (truth.values != 1) & truth.window
        if not bad.any():
            return
        first = int(np.flatnonzero(bad)[0])
        if not isinstance(node, tree.Held):
            yield Broken(self._say.clock(first), self._at(first))
            return
        row = lost_share(bad, truth.window, node.amount.value_si)
        forgiven = f"{100 * (1 - node.amount.value_si):.4g} %"
        sentence = f"more than {forgiven} of its ticks had broken it"
        began = f", the first at {self._say.clock(first):.3f} s"
        worst = f": {self._at(first)}" if self._sides else ""
        yield Broken(self._say.clock(row), f"{sentence}{began}{worst}", final=False)

    def _at(self, row: int) -> str:
        if not self._sides:
            return f"'{self._say.text(self._condition)}' did not hold"
        return self._say.at(self._condition, self._sides, row)

    def _number(self) -> Iterator[Broken]:
        """The break of one number, which the ticks that it was made from have brought about."""
        reduced = [n for n in tree.walk(self._condition) if isinstance(n, tree.Reduce)]
        series = [self._value(n.arg) for n in reduced]
        windows = [s.window for s in series if s.window is not None]
        if not windows or len(windows) < len(series):
            return
        said = self._say.number(self._condition, False, self._sides).text
        part = self._sides[0][0] if self._sides else self._condition
        if len(reduced) > 1 or part is not reduced[0]:
            rows = [row for s in series if (row := reached(part, s, None, None)[0]) is not None]
            if rows:
                yield Broken(self._say.clock(max(rows)), f"it was judged, {said}", final=False)
            return
        low, high = (None if b is None else float(b[0]) for b in self._numbers(_ONE)[1])
        row, outside = reached(part, series[0], low, high)
        if row is None:
            return
        sentence = f"it passed its bound; {said}" if outside else f"it was judged, {said}"
        if reduced[0].reducer == "rms" and row != int(np.flatnonzero(windows[0])[-1]):
            sentence = f"it could not be met any more, {said}"
        yield Broken(self._say.clock(row), sentence, final=outside)

    def _numbers(self, truth: Series) -> tuple[Vector, Bounds]:
        """The measured values and their bounds at the ticks that count, of one number (1,)."""
        if truth.window is None:
            value, *bounds = (np.atleast_1d(s.number) for _, s in self._sides)
        else:
            shape = truth.values.shape
            value, *bounds = (
                np.broadcast_to(s.values, shape)[truth.window] for _, s in self._sides
            )
        if isinstance(self._condition, tree.WithinNode):
            return value, (bounds[0], bounds[1])
        below = self._say.relation(self._condition, self._sides).startswith("<")
        return value, (None, bounds[0]) if below else (bounds[0], None)
