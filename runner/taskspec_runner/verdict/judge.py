"""Whether a run did what its task expects, and what was measured."""

from __future__ import annotations

from taskspec.expression import Expression, evaluate, tree
from taskspec.expression.series import Series, SeriesAlgebra
from taskspec.program.program import Program
from taskspec.spec import Expectation, Task
from taskspec_runner.record.history import History
from taskspec_runner.record.named import column_of, scope_of
from taskspec_runner.verdict.condition_margins import ConditionMargins
from taskspec_runner.verdict.diagnosed import line_of
from taskspec_runner.verdict.energy import RunEnergies
from taskspec_runner.verdict.explanation import Explainer, Explanation, Sides
from taskspec_runner.verdict.judged import Broken, Judged, Margin, MeasuredValue
from taskspec_runner.verdict.lookup import Elsewhere, Lookup
from taskspec_runner.verdict.replay import Replay


def judge(task: Task, history: History, elsewhere: Elsewhere) -> tuple[Judged, ...]:
    """Judges every expectation of a task.

    Args:
        task: whose `expect` is judged.
        history: the true signals of the run.
        elsewhere: (name, axis, frame) -> (n,) that signal in the axes of another frame.
    """
    lookup = Lookup(task, history, elsewhere)
    return tuple(_judge(expectation, task, history, lookup) for expectation in task.expect)


def judge_run(program: Program, history: History, true: Task | None = None) -> tuple[Judged, ...]:
    """Judges every expectation of a program's task on the ticks of its run.

    Args:
        program: that ran.
        history: what it recorded.
        true: the task with the world as it was; None for what its `truth` says.
    """
    context = program.context
    replay = Replay(context.robot, context.frames, program.stages, history, context.moving_bases)
    beside = RunEnergies(program, history, true).beside()
    return judge(context.loaded.task, beside, replay.signal)


def _judge(expectation: Expectation, task: Task, history: History, lookup: Lookup) -> Judged:
    expression = expectation.expression
    examiner = _Examiner(expression, task, history, lookup)
    passed, explanation = examiner.examine(expression.tree)
    names = list(lookup.names(expression.tree))
    stages = {meaning.stage for _, meaning in names}
    columns = {
        f"{column_of(m)} in {n.frame}" if n.frame else column_of(m) for n, m in names
    }  # fmt: skip
    return Judged(
        text=expectation.text,
        passed=passed,
        explanation=explanation,
        measured=tuple(examiner.measured),
        signals=tuple(dict.fromkeys(str(name) for name, _ in names)),
        stage=stages.pop() if len(stages) == 1 else None,
        signal=columns.pop() if len(columns) == 1 else None,
        band=examiner.band(expression.tree),
        margins=tuple(examiner.margins),
        broken=examiner.broken if passed is False else None,
        line=line_of(expression.span),
        unrecorded=lookup.unrecorded(expression.tree) if passed is None else (),
        name=expectation.name,
    )


class _Examiner:
    """Walks the conditions of one expectation; `and` judges each of its items by itself."""

    def __init__(
        self, expression: Expression, task: Task, history: History, lookup: Lookup
    ) -> None:
        self._lookup, self._find = lookup, lookup.within(expression.tree)
        self._algebra = SeriesAlgebra()
        self._say = Explainer(expression, scope_of(task), history.columns.get("clock"))
        self.measured: list[MeasuredValue] = []
        self.margins: list[Margin] = []
        self._breaks: list[Broken] = []

    @property
    def broken(self) -> Broken | None:
        """The first break of the conditions that have been examined."""
        return min(self._breaks, key=lambda each: each.clock, default=None)

    def value(self, node: tree.Node) -> Series:
        return evaluate(node, self._algebra, self._find)

    def examine(self, node: tree.Node) -> tuple[bool | None, str]:
        """Whether a condition was met, None if what it needs was not recorded; and in words."""
        if isinstance(node, tree.Logic) and node.op == "and":
            found = [self.examine(item) for item in node.items]
            kinds = [passed for passed, _ in found]
            passed = False if False in kinds else None if None in kinds else True
            return passed, "; ".join(text for _, text in found)
        truth = self.value(node)
        inner = self.value(node.x) if isinstance(node, tree.Held) else truth
        if not truth.known or not inner.known:
            said = self._say.unknown(node, inner)
            lacking = self._lookup.unrecorded(node)
            if lacking and (inner.window is None or inner.window.any()):
                return None, f"needs {', '.join(lacking)}, which was not recorded"
            self._breaks += self._say.unknown_since(inner, said)
            return False, said.text
        held = bool((truth.inside() == 1).all())
        said = self._explain(node, held, inner)
        self.measured += said.measured
        condition = node.x if isinstance(node, tree.Held) else node
        extents = ConditionMargins(self._say, self.value, condition, self._sides(condition))
        self.margins += extents.margins(node, inner)
        if not held:
            self._breaks += extents.breaks(node, inner)
        return held, said.text

    def _explain(self, node: tree.Node, passed: bool, truth: Series) -> Explanation:
        if isinstance(node, tree.Held):
            return self._say.share(node, truth, self._sides(node.x))
        if truth.window is None:
            return self._say.number(node, passed, self._sides(node))
        return self._say.every_tick(node, truth, self._sides(node))

    def _sides(self, node: tree.Node) -> Sides:
        return [(part, self.value(part)) for part in self._lookup.compared(node)]

    def band(self, node: tree.Node) -> tuple[float | None, float | None] | None:
        """The bounds of one plain signal, with or without `for`; None on an open side.

        A largest value below a bound, or a smallest one above it, is a bound on every tick.
        """
        inner = node.x if isinstance(node, tree.Held) else node
        sides = self._sides(inner)
        if not sides or any(self._lookup.measures(part) for part, _ in sides[1:]):
            return None
        if any(series.window is not None for _, series in sides[1:]):
            # A bound that was set meanwhile is no line.
            return None
        signal, bounds = sides[0][0], [series.number for _, series in sides[1:]]
        reducer = signal.reducer if isinstance(signal, tree.Reduce) else ""
        signal = signal.arg if isinstance(signal, tree.Reduce) else signal
        size = isinstance(signal, tree.Call) and signal.function == "abs"
        name = signal.args[0] if isinstance(signal, tree.Call) and size else signal
        if not isinstance(name, tree.Name) or name.frame is not None:
            return None
        if isinstance(inner, tree.WithinNode):
            return None if size or reducer else (bounds[0], bounds[1])
        assert isinstance(inner, tree.Compare)
        below = inner.op.startswith("<") == (sides[0][0] is inner.left)
        if reducer not in ("", "max" if below else "min"):
            return None
        if size:
            return (-bounds[0], bounds[0]) if below else None
        return (None, bounds[0]) if below else (bounds[0], None)
