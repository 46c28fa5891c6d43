"""What an expectation measures, tick by tick, against its bounds: the lines that a chart of it has.

An expectation is judged by one number or by a share of ticks. Its course shows how that came about:

- of a largest, smallest or last value the measured signal itself;
- of a root mean square, sqrt(sum of x^2 up to the tick / number of all ticks), which only rises
  and passes the bound at the tick from which on it cannot be met any more;
- of a mean and a deviation those of the ticks so far.

At the last tick all of them have the value that is judged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, evaluate, tree
from taskspec.expression.series import Series, SeriesAlgebra
from taskspec.program.program import Program
from taskspec.text.units import in_unit
from taskspec_runner.record.file_array import counted, full
from taskspec_runner.record.history import History, Mask, Vector
from taskspec_runner.record.named import column_of, scope_of
from taskspec_runner.verdict.energy import RunEnergies
from taskspec_runner.verdict.explanation import Explainer
from taskspec_runner.verdict.lookup import Lookup
from taskspec_runner.verdict.replay import Replay


@dataclass(frozen=True, slots=True)
class MeasuredCourse:
    """One condition of an expectation over the run.

    Attributes:
        text: of the expectation.
        label: of the measured part, as written, with "so far" where it grows with the ticks.
        signal: log name of the measured signal, such as `norm(force.x, force.y, force.z)`; the
            label where it is none of those that charts have.
        values: (n,) measured, in `unit`; NaN where it does not count.
        low, high: (n,) bounds in `unit`, NaN where they do not count, None on an open side.
        unit: in which the expectation has its bounds.
        factor: from SI to `unit`.
        grows: whether its last value alone is judged, as of a mean.
    """

    text: str
    label: str
    signal: str
    values: Vector
    low: Vector | None
    high: Vector | None
    unit: str
    factor: float
    grows: bool = False


class Courses:
    """The courses of the expectations of a run.

    Args:
        program: whose task expects it.
        history: the run.
    """

    def __init__(self, program: Program, history: History) -> None:
        context = program.context
        self._task, self._history = context.loaded.task, history
        replay = Replay(
            context.robot, context.frames, program.stages, history, context.moving_bases
        )
        beside = RunEnergies(program, history).beside()
        self._lookup = Lookup(self._task, beside, replay.signal)

    def of(self, text: str) -> tuple[MeasuredCourse, ...]:
        """Those of an expectation by its text, one a condition; none of conditions on counts."""
        for expectation in self._task.expect:
            if expectation.text == text:
                clock = self._history.columns.get("clock")
                say = Explainer(expectation.expression, scope_of(self._task), clock)
                walked = _Walk(text, expectation.expression, self._lookup, len(self._history), say)
                return tuple(walked.of(expectation.expression.tree))
        return ()


class _Walk:
    """Walks the conditions of one expectation."""

    def __init__(
        self, text: str, expression: Expression, lookup: Lookup, ticks: int, say: Explainer
    ) -> None:
        self._text, self._lookup, self._ticks, self._say = text, lookup, ticks, say
        self._value = _running(lookup.within(expression.tree))

    def of(self, node: tree.Node) -> Iterator[MeasuredCourse]:
        if isinstance(node, tree.Logic) and node.op == "and":
            for item in node.items:
                yield from self.of(item)
            return
        inner = node.x if isinstance(node, tree.Held) else node
        measured = self._conditions(inner) if _compares(inner) else self._truth(inner)
        if measured is not None:
            yield measured

    def _truth(self, node: tree.Node) -> MeasuredCourse | None:
        """A condition that is no comparison, as 0 and 1; it is to be 1."""
        truth = self._value(node)
        if truth.window is None:
            return None
        label = self._say.text(node)
        one = full(self._ticks, 1.0)
        return MeasuredCourse(self._text, label, label, self._seen(truth), one, None, "", 1.0)

    def _conditions(self, node: tree.Node) -> MeasuredCourse | None:
        sides = [(part, self._value(part)) for part in self._lookup.compared(node)]
        (part, series), *bounds = sides
        if series.window is None:
            return None
        unit = self._say.unit(node, sides)
        factor = in_unit(1.0, unit)
        counts = self._last(series.window) if _is_last(part) else series.window
        lines = [factor * np.where(counts, self._wide(b), np.nan) for _, b in bounds]
        low: Vector | None
        high: Vector | None
        if isinstance(node, tree.WithinNode):
            low, high = lines
        elif self._say.relation(node, sides).startswith("<"):
            low, high = None, lines[0]
        else:
            low, high = lines[0], None
        values = factor * self._seen(series)
        signal, label = self._named(part)
        grows = label.endswith(_SO_FAR)
        return MeasuredCourse(self._text, label, signal, values, low, high, unit, factor, grows)

    def _named(self, node: tree.Node) -> tuple[str, str]:
        """Log name of what is measured, and what it is called in a legend."""
        label = self._say.text(node)
        reducers = [n.reducer for n in tree.walk(node) if isinstance(n, tree.Reduce)]
        if isinstance(node, tree.Reduce) and node.reducer in _AS_IT_IS:
            return self._signal(node.arg) or label, self._say.text(node.arg)
        if set(reducers) - {"last"}:
            return label, f"{label}{_SO_FAR}"
        return self._signal(node) or label, label

    def _signal(self, node: tree.Node) -> str:
        if isinstance(node, tree.Name) and node.frame is None:
            meaning = self._lookup.meaning(node)
            return column_of(meaning) if meaning.kind != "visits" else ""
        if isinstance(node, tree.Call) and node.function == "norm":
            parts = [self._signal(arg) for arg in node.args]
            return f"norm({', '.join(parts)})" if all(parts) else ""
        return ""

    def _last(self, window: Mask) -> Mask:
        """The one tick at which a last value is held against its bounds."""
        rows = np.flatnonzero(window)
        last = full(self._ticks, False)
        last[rows[-1:]] = True
        return last

    def _seen(self, series: Series) -> Vector:
        assert series.window is not None
        return np.where(series.window, self._wide(series), np.nan)

    def _wide(self, series: Series) -> Vector:
        return np.broadcast_to(series.values, (self._ticks,))


_SO_FAR = ", so far"
#: Reducers whose number is that of one tick, so that the signal itself shows it.
_AS_IT_IS = ("max", "min", "last")


def _is_last(node: tree.Node) -> bool:
    return isinstance(node, tree.Reduce) and node.reducer == "last"


def _compares(node: tree.Node) -> bool:
    return isinstance(node, tree.Compare | tree.WithinNode)


def _running(find: Callable[[tree.Name], Series]) -> Callable[[tree.Node], Series]:
    """The value of a part; of a largest or smallest one that stands alone, the signal itself."""
    algebra = _RunningAlgebra()

    def value(node: tree.Node) -> Series:
        if isinstance(node, tree.Reduce) and node.reducer in _AS_IT_IS:
            return evaluate(node.arg, algebra, find)
        return evaluate(node, algebra, find)

    return value


class _RunningAlgebra(SeriesAlgebra):
    """The operations on series with reducers that run along: a value at each tick."""

    def reduce(self, node: tree.Node, reducer: str, x: Series) -> Series:  # noqa: ARG002
        """The number as it is known at each tick."""
        if x.window is None:
            return x
        inside = x.inside()
        values = full(len(x.values), np.nan)
        if len(inside):
            values[x.window] = _RUNNING[reducer](inside)
        return Series(values, x.window, x.gaps)


def _mean(x: Vector) -> Vector:
    return np.cumsum(x) / counted(len(x), 1)


def _deviation(x: Vector) -> Vector:
    # About the first value, so that squares of what all ticks share cancel nothing.
    off = x - x[0]
    return np.sqrt(np.maximum(_mean(off**2) - _mean(off) ** 2, 0.0))


_RUNNING: dict[str, Callable[[Vector], Vector]] = {
    "max": np.maximum.accumulate,
    "min": np.minimum.accumulate,
    "mean": _mean,
    "rms": lambda x: np.sqrt(np.cumsum(x**2) / len(x)),
    "std": _deviation,
    "last": lambda x: x,
}
