"""Stages as the file's own guards find them in a log: which tick ends which stage.

The expressions of `until` and `fail_if` are evaluated over what was recorded since the stage began,
in the order of one tick: `fail_if`, `until`, `within`, planned time. As in a run, a stage's first
tick ends nothing.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, takewhile

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.expression import Expression, Meaning, Scope, evaluate, resolve, tree
from taskspec.expression.scope import CONSTANTS, ScopeKind
from taskspec.expression.series import Series, SeriesAlgebra
from taskspec.geometry.axis import TRANSLATIONS
from taskspec.program import events
from taskspec.program.execution.transition import END, FAIL, is_good, leads_to
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.signals.entries import TOUCHING
from taskspec.spec import Stage
from taskspec.spec.params import worths
from taskspec.text.units import TIME, show
from taskspec_runner.errors import InputError
from taskspec_runner.record.file_array import BLOCK_ROWS, counted
from taskspec_runner.record.named import column_of, param_column
from taskspec_runner.recorded.ticks import Ticks, filled

Vector = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Signals that count from where a stage began, or that only a controller knows.
_INNER = ("travel", "path_done", "error", "limited", "force_inconsistent", "joint_error")
#: Visits beyond which a log is said to go round in circles.
_MOST_VISITS = 100_000


#: Where a stage leads of which the log does not show whether it was over.
UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class LastStage:
    """What a log shows of the end of its last stage.

    Attributes:
        to: `end`, `fail`, the name of the stage that would follow, `unknown`, or empty where the
            log ends before the stage does.
        text: why, as a sentence.
        timed: whether the file's times decided that, which what a log states cannot overrule.
    """

    to: str
    text: str
    timed: bool = False


class _Since(SeriesAlgebra):
    """The language over the ticks since a stage began; `for` and reducers look back to there."""

    def __init__(self, period: float) -> None:
        self._period = period

    def held(self, node: tree.Held, x: Series, amount: float) -> Series:  # noqa: ARG002
        """Whether x has held for some seconds without a break."""
        rows = counted(len(x.values))
        broken = np.where(x.values == 1, -1, rows)
        since = rows - np.maximum.accumulate(broken) - 1
        long = since * self._period >= amount - self._period / 2
        return Series(np.where((x.values == 1) & long, 1.0, 0.0), x.window)

    def reduce(self, node: tree.Reduce, reducer: str, x: Series) -> Series:  # noqa: ARG002
        """The reducer over the stage so far."""
        values = x.values
        count = counted(len(values), 1)
        if reducer == "last":
            return x
        if reducer in ("min", "max"):
            function = np.minimum if reducer == "min" else np.maximum
            return Series(function.accumulate(values), x.window)
        mean, square = np.cumsum(values) / count, np.cumsum(values**2) / count
        if reducer == "mean":
            return Series(mean, x.window)
        spread = square if reducer == "rms" else np.maximum(square - mean**2, 0.0)
        return Series(np.sqrt(spread), x.window)


class GuardWalk:
    """Walks a log from stage to stage."""

    def __init__(
        self,
        program: Program,
        columns: Callable[[CompiledStage], Mapping[str, Vector]],
        ticks: Ticks,
        what: str,
    ) -> None:
        """Takes what was recorded.

        Args:
            program: of the task.
            columns: (ticks,) of every signal, in the axes of a stage; the same mapping for the
                same axes.
            ticks: of the log.
            what: the columns are of, for messages.
        """
        self._columns_of, self._what = columns, what
        self._over, self._ticks, self._period = ticks, ticks.count, ticks.period
        self._filled: dict[tuple[int, str], Vector] = {}
        self._stages = {stage.name: stage for stage in program.stages}
        task = program.context.loaded.task
        objects = {name: thing.kind for name, thing in task.world.items()}
        self._scope = Scope(ScopeKind.GUARD, task.params, frozenset(task.stages), objects)
        self._params = task.params
        self._visits: dict[str, int] = {}

    def stages(self) -> tuple[list[tuple[int, str]], int, str]:
        """First tick and name of each visit, the tick after the last one, and where that led.

        It led to `end`, `fail`, or nowhere if the log ends before.

        Raises:
            InputError: a guard needs what was not recorded, or what a log cannot say.
        """
        found: list[tuple[int, str]] = []
        names = list(self._stages)
        start, name = 0, names[0]
        rounds, tries = 1, {name: 1}
        while len(found) < _MOST_VISITS:
            found.append((start, name))
            self._visits[name] = self._visits.get(name, 0) + 1
            stage = self._stages[name]
            end, event = self._end(stage, start)
            if event is None:
                return found, self._ticks, ""
            following = names[names.index(name) + 1] if name != names[-1] else END
            again = is_good(event) and rounds < stage.plan.spec.repeat
            to = name if again else leads_to(stage.plan.spec, event, following)
            attempts = self._stages[to].plan.spec.attempts if to in self._stages else None
            if attempts is not None and not again and tries.get(to, 0) >= attempts:
                to = FAIL
            rounds = rounds + 1 if again else 1
            tries[to] = tries.get(to, 0) + (not again)
            if to not in self._stages:
                return found, end, to
            start, name = end, to
        raise InputError("the guards of the file go from stage to stage without an end in this log")

    def _end(self, stage: CompiledStage, start: int) -> tuple[int, events.Event | None]:
        """The tick at which a stage ends that began at one, and by what; None at the log's end."""
        ahead = BLOCK_ROWS
        while start + ahead < self._ticks:
            end, event = self._end_within(stage, slice(start, start + ahead))
            if event is not None:
                return end, event
            ahead *= 8
        return self._end_within(stage, slice(start, self._ticks))

    def last_stage(self, visits: Sequence[tuple[int, str]], sample: float) -> LastStage:
        """What the log shows of the end of the stage in which it ends.

        `fail_if`, `until` and `within` are evaluated at the ticks that were recorded; a planned
        time is over, too, if the next sample would have come after it: the tick that ends a stage
        is not recorded as one of it.

        Args:
            visits: first tick and name of each.
            sample: time between two samples of the log [s].
        """
        first, name = visits[-1]
        stage, spec = self._stages[name], self._stages[name].plan.spec
        names = [*self._stages]
        following = names[names.index(name) + 1] if name != names[-1] else END
        targets = spec.targets(following)
        if END not in (*targets, spec.on_fail):
            return LastStage(targets[-1], f"the log ends, and '{targets[-1]}' would follow")
        self._visits = dict(Counter(each for _, each in visits))
        rows = slice(first, self._ticks)
        t = np.asanyarray(counted(rows.stop - first) * self._period, dtype=np.float64)
        found, unknown = self._late(stage, t), ""
        with suppress(InputError):
            found += self._guarded(events.FAIL_IF, stage, rows, t)
        try:
            found += self._guarded(events.UNTIL, stage, rows, t)
        except InputError:
            unknown = f"what ends it, `{spec.until}`, cannot be evaluated from it"
        tick, event = _first(found, rows)
        if event is None and spec.until is None:
            planned = self._planned(spec, len(set(targets)), float(t[-1]), sample)
            if isinstance(planned, LastStage):
                return planned
            event = replace(planned, branch=len(targets) - 1)
        again = sum(1 for _ in takewhile(lambda each: each[1] == name, reversed(visits)))
        if event is not None and is_good(event) and again < spec.repeat:
            unknown, event = f"it is repeated, {again} of {spec.repeat} times are known", None
        if event is not None:
            return _led(leads_to(spec, event, following), event, tick * self._period)
        if unknown:
            return _unknown(unknown)
        return LastStage("", f"the log ends before `{spec.until}` held")

    def _planned(
        self, spec: Stage, targets: int, t: float, sample: float
    ) -> LastStage | events.Event:
        """The end of a stage without `until` at the end of a log, or what the log shows instead."""
        lasted, took = t + self._period, spec.time or 0.0
        if lasted + max(sample - self._period, 0.0) < took - self._period / 2:
            text = f"the log ends {show(lasted, TIME)} into the stage"
            return LastStage("", f"{text}, which takes {show(took, TIME)}", timed=True)
        if self._moves(spec):
            return _unknown("that its moves are done shows in no log")
        if targets > 1:
            return _unknown("where it leads is decided at the tick after it")
        return events.Event(events.DONE, "done", "time")

    def _guarded(
        self, kind: str, stage: CompiledStage, rows: slice, t: Vector
    ) -> list[tuple[Mask, events.Event]]:
        """Where `fail_if` or `until` holds."""
        spec = stage.plan.spec
        guard = spec.fail_if if kind == events.FAIL_IF else spec.until
        if guard is None:
            return []
        holds = self._guard(stage, kind, guard, rows, t)
        return [*self._by_way(stage, holds, events.Event(kind, kind, str(guard)), rows, t)]

    def _late(self, stage: CompiledStage, t: Vector) -> list[tuple[Mask, events.Event]]:
        """Where `within` is over."""
        within = stage.plan.spec.within
        if within is None or within.time is None:
            return []
        late = t >= within.time - self._period / 2
        return [(late, events.Event(events.WITHIN, "time", "within"))]

    @staticmethod
    def _moves(spec: Stage) -> bool:
        """Whether a stage without a guard ends when its moves are done."""
        given = (axis.given for axis in spec.axes.values())
        moves = any(mode is not None and mode.ends for mode in given)
        return spec.time is None or moves or spec.path is not None

    def _end_within(self, stage: CompiledStage, rows: slice) -> tuple[int, events.Event | None]:
        """The same, as far as some ticks from the stage's first one on say it."""
        spec, start = stage.plan.spec, rows.start
        t = np.asanyarray(counted(rows.stop - start) * self._period, dtype=np.float64)
        kinds = (events.FAIL_IF, events.UNTIL)
        found = [*chain.from_iterable(self._guarded(kind, stage, rows, t) for kind in kinds)]
        found += self._late(stage, t)
        if spec.until is None:
            if spec.time is None or self._moves(spec):
                # What ends the last stage ends the task, and the log with it.
                if not self._is_last(stage):
                    raise InputError(
                        f"stage '{stage.name}' ends when its moves are done, which no guard shows "
                        "in a log; state the stages by a column ('stage') or by times ('stages') "
                        "in the map"
                    )
            else:
                over = t >= spec.time - self._period / 2
                done = events.Event(events.DONE, "done", "time")
                found += self._by_way(stage, over, done, rows, t)
        return _first(found, rows)

    def _is_last(self, stage: CompiledStage) -> bool:
        """Whether the task ends as soon as a stage is done."""
        spec = stage.plan.spec
        last = stage.name == [*self._stages][-1]
        return last and spec.repeat <= 1 and set(spec.targets(END)) == {END}

    def _by_way(
        self, stage: CompiledStage, holds: Mask, event: events.Event, rows: slice, t: Vector
    ) -> Iterator[tuple[Mask, events.Event]]:
        """An end as one event for each branch, as in a run."""
        for number, branch in enumerate(stage.plan.spec.next[:-1] if is_good(event) else ()):
            assert branch.when is not None
            taken = holds & self._guard(stage, "'next'", branch.when, rows, t)
            yield taken, replace(event, branch=number)
        yield holds, event

    def _guard(
        self, stage: CompiledStage, kind: str, guard: Expression, rows: slice, t: Vector
    ) -> Mask:
        def find(name: tree.Name) -> Series:
            meaning = resolve(name.path, self._scope)
            if meaning is None or name.frame is not None or meaning.name in _INNER:
                raise InputError(
                    f"the {kind} of stage '{stage.name}' needs {name}, which a log does not say; "
                    "state the stages by a column ('stage') or by times ('stages') in the map"
                )
            return self._value(stage, kind, name, meaning, rows, t)

        truth = evaluate(guard.tree, _Since(self._period), find)
        return np.broadcast_to(truth.values == 1, t.shape)

    def _value(
        self,
        stage: CompiledStage,
        kind: str,
        name: tree.Name,
        meaning: Meaning,
        rows: slice,
        t: Vector,
    ) -> Series:
        if meaning.kind == "param":
            return self._param(stage, meaning.name, rows)
        if meaning.kind == "constant":
            return Series.one(CONSTANTS[meaning.name][0])
        if meaning.kind == "visits":
            return Series.one(float(self._visits.get(str(meaning.stage), 0)))
        if meaning.kind == "clock":
            return Series(t if meaning.name == "t" else t + rows.start * self._period)
        if meaning.kind == "signal" and meaning.axis and meaning.axis not in stage.plan.axes:
            return Series.one(0.0)
        column = column_of(meaning)
        values = self._measured(column, self._columns_of(stage))
        if values is None:
            raise InputError(
                f"the {kind} of stage '{stage.name}' needs {name}, which was not recorded; record "
                "it, or state the stages by a column ('stage') or by times ('stages') in the map"
            )
        return Series(values[rows])

    def _param(self, stage: CompiledStage, name: str, rows: slice) -> Series:
        """The value of a param; of one that may be set what was recorded, else as declared."""

        def slot(live: str) -> Series:
            values = self._measured(param_column(live), self._columns_of(stage))
            return Series.one(self._params[live].value) if values is None else Series(values[rows])

        if not self._params[name].live:
            return Series.one(self._params[name].value)
        return worths(self._params, SeriesAlgebra(), slot)[name]

    def _measured(self, column: str, columns: Mapping[str, Vector]) -> Vector | None:
        """What a controller would have measured: the measured value where there is one beside."""
        if column == "touching":
            axes = [self._measured(f"force.{axis}", columns) for axis in TRANSLATIONS]
            forces = [values for values in axes if values is not None]
            if len(forces) == len(axes):
                size = np.sqrt(sum(values**2 for values in forces))
                return (size > TOUCHING).astype(float)
        name = f"{column}.measured" if f"{column}.measured" in columns else column
        key = (id(columns), name)
        if name in columns and key not in self._filled:
            # What has no value in whole stages is examined where it has one.
            what = f"{self._what}: {name}"
            sparse = column.endswith("gap")
            self._filled[key] = filled(columns[name], self._over, what, sparse=sparse)
        return self._filled.get(key)


def _unknown(why: str) -> LastStage:
    """A last stage of which the log does not show whether it was over."""
    return LastStage(UNKNOWN, f"the log ends in the stage, and {why}")


def _led(to: str, event: events.Event, clock: float) -> LastStage:
    """Where an event of the last stage led, at a run time [s]."""
    if to == FAIL:
        why = "`within` was over" if event.kind == events.WITHIN else f"`{event.text}` held"
        return LastStage(FAIL, f"{why} at {show(clock, TIME)}, which leads to fail")
    return LastStage(to, "the log ends" if to == END else f"the log ends, and '{to}' would follow")


def _first(
    found: Sequence[tuple[Mask, events.Event]], rows: slice
) -> tuple[int, events.Event | None]:
    """The first tick at which one of some events ends a stage; its first tick ends nothing."""
    first, event = int(rows.stop), None
    for holds, each in found:
        ends = np.flatnonzero(holds[1:])
        if len(ends) and rows.start + 1 + int(ends[0]) < first:
            first, event = rows.start + 1 + int(ends[0]), each
    return first, event
