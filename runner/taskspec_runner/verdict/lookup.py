"""Names of an expectation as series over the history of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from taskspec.expression import Meaning, resolve, tree
from taskspec.expression.scope import CONSTANTS
from taskspec.expression.series import Series, SeriesAlgebra
from taskspec.spec import Task
from taskspec.spec.params import slots_of, worths
from taskspec_runner.record.file_array import full
from taskspec_runner.record.history import History, NotRecordedError
from taskspec_runner.record.named import column_of, param_column, scope_of

Vector = NDArray[np.float64]

#: name, axis, frame -> (n,) the signal in the axes of that frame.
Elsewhere = Callable[[str, str | None, str], Vector]


class Lookup:
    """Finds the value of a name in a history.

    Args:
        task: for params and names.
        history: the run.
        elsewhere: resolves `signal in FRAME`.
    """

    def __init__(self, task: Task, history: History, elsewhere: Elsewhere) -> None:
        self._params = task.params
        self._history, self._elsewhere = history, elsewhere
        self._scope = scope_of(task)
        self._worths: dict[str, Series] = {}

    def meaning(self, name: tree.Name) -> Meaning:
        """The meaning of a checked name."""
        meaning = resolve(name.path, self._scope)
        assert meaning is not None, name
        return meaning

    def __call__(self, name: tree.Name) -> Series:
        """The value of a name; a signal without one is NaN and says why."""
        meaning = self.meaning(name)
        if meaning.kind == "param":
            return self._param(meaning.name)
        if meaning.kind == "constant":
            return Series.one(CONSTANTS[meaning.name][0])
        if meaning.kind == "visits":
            visits = sum(visit.stage == meaning.stage for visit in self._history.visits())
            return Series.one(float(visits))
        window = self._history.window(meaning.stage)
        if not window.any():
            gap = f"stage '{meaning.stage}' was never visited" if meaning.stage else (
                "the run has no ticks")  # fmt: skip
            return Series(full(len(window), np.nan), window, (gap,))
        values = self._values(meaning, name.frame)
        if values is None:
            return Series(full(len(window), np.nan), window, (self._absent(name, meaning),))
        missing = window & np.isnan(values)
        gaps = (self._missing(name, meaning, missing),) if missing.any() else ()
        return Series(values, window, gaps)

    def _param(self, name: str) -> Series:
        """The value of a param; of one that may be set, or follows from such, at every tick."""
        if not self._params[name].live:
            return Series.one(self._params[name].value)
        if not self._worths:
            self._worths = worths(self._params, SeriesAlgebra(), self._slot)
        return self._worths[name]

    def _slot(self, name: str) -> Series:
        """The value at every tick of a param that may be set; declared where none is recorded."""
        values = self._history.columns.get(param_column(name))
        if values is None:
            return Series.one(self._params[name].value)
        return Series(values, self._history.window(None))

    def within(self, root: tree.Node) -> Callable[[tree.Name], Series]:
        """This lookup for one expression, in which a norm leaves out what has no value.

        `norm(force)` of a planar arm has two components, `norm(error)` those of the axes that
        follow a motion. Where none has a value, neither has the norm. What a last value is compared
        with counts as it was at that tick.
        """
        groups = {
            id(arg): node.args
            for node in tree.walk(root)
            if isinstance(node, tree.Call) and node.function == "norm"
            for arg in node.args
            if all(isinstance(a, tree.Name) for a in node.args)
        }

        ends = self._ends(root)

        def find(name: tree.Name) -> Series:
            series = self(name)
            if id(name) in ends and series.window is not None:
                rows = np.flatnonzero(ends[id(name)])
                return Series.one(series.values[rows[-1]] if rows.size else np.nan)
            group = groups.get(id(name), ())
            if not (group and series.gaps and series.inside().size) or self._lacks(name):
                return series
            parts = [self(part).values for part in group if isinstance(part, tree.Name)]
            nothing = reduce(np.logical_and, map(np.isnan, parts))
            left_out = np.isnan(series.values) & ~nothing
            return replace(series, values=np.where(left_out, 0.0, series.values))

        return find

    def _ends(self, root: tree.Node) -> dict[int, NDArray[np.bool_]]:
        """The ticks (n,) of the last values that params are compared with, by the params' node."""
        found: dict[int, NDArray[np.bool_]] = {}
        for condition in tree.walk(root):
            if not isinstance(condition, tree.Compare | tree.WithinNode):
                continue
            reduced = [n for n in tree.walk(condition) if isinstance(n, tree.Reduce)]
            inside = {id(n) for each in reduced for n in tree.walk(each)}
            of = [(node, meaning.stage) for node, meaning in self.names(condition)]
            if {n.reducer for n in reduced} != {"last"} or any(id(n) not in inside for n, _ in of):
                continue
            windows = [self._history.window(stage) for _, stage in of]
            for name in tree.walk(condition):
                if isinstance(name, tree.Name) and id(name) not in inside and windows:
                    found[id(name)] = reduce(np.logical_and, windows)
        return found

    def names(self, root: tree.Node) -> Iterator[tuple[tree.Name, Meaning]]:
        """The measured names of an expression; params and constants left out."""
        for node in tree.walk(root):
            if isinstance(node, tree.Name):
                meaning = self.meaning(node)
                if meaning.kind not in ("param", "constant"):
                    yield node, meaning

    def measures(self, root: tree.Node) -> bool:
        """Whether an expression has a measured name."""
        return any(True for _ in self.names(root))

    def compared(self, condition: tree.Node) -> tuple[tree.Node, ...]:
        """The sides of a condition, the measured one first; empty if it compares nothing."""
        match condition:
            case tree.WithinNode():
                return condition.x, condition.low, condition.high
            case tree.Compare(left=left, right=right) if self.measures(left) or (
                self._is_live(left) and not self.measures(right)
            ):
                return condition.left, condition.right
            case tree.Compare():
                return condition.right, condition.left
            case _:
                return ()

    def _is_live(self, root: tree.Node) -> bool:
        """Whether an expression follows from a param that may be set."""
        return bool(slots_of(self._params, root))

    def unrecorded(self, root: tree.Node) -> tuple[str, ...]:
        """Columns that an expression needs and that were not recorded, in its order."""
        found = (self._lacks(node) for node in tree.walk(root) if isinstance(node, tree.Name))
        return tuple(dict.fromkeys(column for column in found if column))

    def _lacks(self, name: tree.Name) -> str:
        """The column that a name needs and that was not recorded; empty if there is none."""
        meaning = self.meaning(name)
        if not self._history.unrecorded or meaning.kind in ("param", "constant", "visits"):
            return ""
        if name.frame is None:
            column = column_of(meaning)
            return column if column in self._history.unrecorded else ""
        try:
            self._elsewhere(meaning.name, meaning.axis, name.frame)
        except NotRecordedError as error:
            return error.column
        return ""

    def _values(self, meaning: Meaning, frame: str | None) -> Vector | None:
        if frame is None:
            column, history = column_of(meaning), self._history
            known = column in history.columns or column in history.unrecorded
            if meaning.kind == "link" and not known:
                # Plant and controller were one loop, or one waited for the other.
                return full(len(history), 0.0)
            return history.columns.get(column)
        try:
            return self._elsewhere(meaning.name, meaning.axis, frame)
        except NotRecordedError:
            return None

    def _absent(self, name: tree.Name, meaning: Meaning) -> str:
        if self._lacks(name):
            return f"{name} was not recorded"
        if meaning.kind == "joint" and not meaning.beside:
            columns = (*self._history.columns, *self._history.unrecorded)
            number = sum(c.startswith("joint.") and c.endswith(".torque") for c in columns)
            if int(meaning.subject or 0) > number:
                return f"the arm has {number} joints, no joint {meaning.subject}"
        given = meaning.signal.given if meaning.signal is not None else ""
        if given:
            return f"{name} is not in the log: it comes of {given}"
        if meaning.axis:
            return f"{name} has no value: the arm does not move along {meaning.axis}"
        return f"{name} is not in the log"

    def _missing(self, name: tree.Name, meaning: Meaning, missing: NDArray[np.bool_]) -> str:
        visits = (visit for visit in self._history.visits() if missing[visit.rows].any())
        where = list(dict.fromkeys(visit.stage for visit in visits))
        stages = "stage " + ", ".join(f"'{stage}'" for stage in where)
        absent = meaning.signal.absent if meaning.signal is not None else ""
        absent = "nothing refers it to a set point there" if meaning.beside else absent
        reason = f" ({absent})" if absent else ""
        hint = "" if meaning.stage or len(where) > 3 else "; name the stage with it"
        return f"{name} has no value in {stages}{reason}{hint}"
