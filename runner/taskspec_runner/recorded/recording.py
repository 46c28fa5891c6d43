"""A recorded log as the history of a task: its samples at the ticks, each in a stage."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import TRANSLATIONS
from taskspec.program.execution.transition import END, FAIL
from taskspec.program.program import Program
from taskspec.program.stages.stage import CompiledStage
from taskspec.signals import SCALARS
from taskspec.signals.entries import TOUCHING
from taskspec.text.suggest import suggestion
from taskspec.text.units import NUMBER, parse_unit
from taskspec_runner.errors import InputError
from taskspec_runner.export.stream import ENDED, OF_TICKS
from taskspec_runner.record.file_array import blocks, counted, empty
from taskspec_runner.record.history import STAGE, TO_REST, History, RecordedColumns
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.recorded.assignment import Assigned, Assignment
from taskspec_runner.recorded.column_map import Columns
from taskspec_runner.recorded.guards import GuardWalk, LastStage
from taskspec_runner.recorded.sample_texts import SampleTexts
from taskspec_runner.recorded.source import LogSource, open_source
from taskspec_runner.recorded.ticks import BRIDGED, NEAR, Ticks, check_rate, filled
from taskspec_runner.recorded.wrench import WrenchTurn

Vector = NDArray[np.float64]

BY_COLUMN, BY_TIMES, BY_GUARDS = "column", "times", "guards"
#: Words of a column of stages that name none: before the task, after it, and how it ended.
_NO_STAGES = ("", TO_REST, END, FAIL)
_BY_GUARDS = {END: "the log ends", FAIL: "the guards of the stage lead to fail"}
_STATED = {END: "the log ends", FAIL: "the log says that the task ended in fail"}


@dataclass(frozen=True, slots=True)
class ForeignLog:
    """What was recorded, at the ticks of a task.

    Attributes:
        history: with the columns that there are.
        last: how its last stage ended, as far as it shows that.
        facts: of the log, its columns and how stages were found, for a manifest.
    """

    history: History
    last: LastStage
    facts: dict[str, Any]


def read_recording(
    program: Program, log: Path, columns: Columns, *, mirrored: bool = False
) -> ForeignLog:
    """A log at the ticks of a task.

    Args:
        program: of the task.
        log: a CSV, Parquet or MCAP file.
        columns: which of its columns is which signal.
        mirrored: whether forces and moments are taken with the opposite sign.

    Raises:
        InputError: log or map cannot be used; the message says what, where and what to do.
    """
    header = None if columns.map.header is None else int(columns.map.header)
    source = open_source(log, header, columns.map.decimal)
    return _Reading(program, source, columns, mirrored).recording()


class _Reading:
    def __init__(
        self, program: Program, source: LogSource, columns: Columns, mirrored: bool
    ) -> None:
        self._program, self._source, self._columns = program, source, columns
        self._period = program.context.period
        layout = LogLayout.of(program, program.context.loaded.task, linked=True)
        self._units = {name: unit for name, unit in layout.units.items() if name != STAGE}
        dimensions = {
            name: parse_unit(unit).dimension if unit else NUMBER
            for name, unit in self._units.items()
        }
        joints = program.context.robot.joint_names
        self._assignment = Assignment(source, columns, dimensions, joints, mirrored=mirrored)
        self._gap = columns.map.gap or BRIDGED * self._period
        #: What the column of stages, or the times of the map, say after the last stage.
        self._after = ""

    def recording(self) -> ForeignLog:
        signals, staged = self._assignment.signals(), self._assignment.stages()
        start, ticks = self._ticks(signals, staged)
        samples = max((each.stamps.samples for each in signals), default=0)
        sample = max((float(np.median(np.diff(e.stamps.times))) for e in signals), default=0.0)
        assigned = {each.name: each.as_data() for each in signals}
        clocks = self._clocks(signals)
        turn = WrenchTurn(self._program, signals, [*self._units], self._assignment.numbers)
        values = {each.name: self._at(each, start, ticks) for each in signals}
        # As recorded they are needed no more.
        del signals
        measured = self._as_measured(values)
        ended, end = "", ticks.count

        def walk() -> GuardWalk:
            return GuardWalk(self._program, in_stage, ticks, str(self._source.path))

        def in_stage(stage: CompiledStage) -> Mapping[str, Vector]:
            return turn.in_stage(stage, values) if turn.needed else values

        if staged is not None:
            found_by, visits = BY_COLUMN, self._by_column(staged, start, ticks)
        elif self._columns.map.stages is not None:
            found_by, visits = BY_TIMES, self._by_times(start, ticks)
            if visits[-1][1] in (END, FAIL):
                end, self._after = visits.pop()
        else:
            found_by = BY_GUARDS
            visits, end, ended = walk().stages()
        # What comes after the end of the task is no part of it.
        ticks = Ticks(ticks.period, end, ticks.gap)
        values = {name: column[:end] for name, column in values.items()}
        last = LastStage(ended, _BY_GUARDS[ended]) if ended else walk().last_stage(visits, sample)
        stated = self._stated_end(samples)
        if stated and not last.timed:
            last = LastStage(stated, _STATED[stated])
        history = self._history(values, visits, ticks)
        if turn.needed:
            history = self._turned(history, turn, measured)
        facts = {
            "log": self._source.path.name,
            "form": self._source.form,
            "columns": assigned,
            "map": Path(self._columns.name).name or None,
            "clocks": clocks,
            "as_measured": measured,
            "not_recorded": sorted(history.unrecorded),
            "stages": found_by,
            "start": self._assignment.origin + start,
            "gap": self._gap,
            "base_turned": turn.half_turn,
        }
        return ForeignLog(history, last, facts)

    def _stated_end(self, samples: int) -> str:
        """Where the log itself says that its task ended: `end`, `fail`, else empty.

        Its column of stages, or the times of a map, go on with a word for that; an export says of
        how many ticks it is, and one that was cut has fewer.
        """
        stated = self._source.stated
        if stated.get(OF_TICKS) == str(samples) and stated.get(ENDED) in (END, FAIL):
            return stated[ENDED]
        return self._after

    def _clocks(self, signals: Sequence[Assigned]) -> list[dict[str, Any]]:
        """What was recorded together: which columns, how many samples, how often [Hz]."""
        found: dict[int, dict[str, Any]] = {}
        for each in signals:
            stamps = each.stamps
            if id(stamps) not in found:
                rate = 1 / float(np.median(np.diff(stamps.times)))
                of = each.column.partition(".")[0] if self._source.timed else ""
                entry = {"of": of, "samples": stamps.samples, "rate": rate}
                if stamps.samples != len(stamps.times):
                    entry |= {"stamps": len(stamps.times), "repeated": self._columns.map.repeated}
                found[id(stamps)] = entry
        return [*found.values()]

    def _turned(self, history: History, turn: WrenchTurn, measured: Sequence[str]) -> History:
        """A history with forces and moments in the axes of its stages."""
        made = turn.over(history)
        for name in measured:
            if f"{name}.measured" in made:
                made[name] = made[f"{name}.measured"]
        columns = {name: made[name] for name in ("clock", "t", *self._units) if name in made}
        missing = frozenset(self._units) - columns.keys()
        return History(RecordedColumns(columns), history.stages, self._stated(columns), missing)

    # Time.

    def _ticks(
        self, signals: Sequence[Assigned], staged: tuple[str, Vector, SampleTexts] | None
    ) -> tuple[float, Ticks]:
        """Time of the log at which the task began [s], and the ticks from there on."""
        columns = [each.column for each in signals]
        if staged is not None and not self._source.timed:
            columns.append(staged[0])
        checked: set[int] = set()
        first, last = -np.inf, np.inf
        for column in columns:
            stamps = self._assignment.stamps(column)
            if id(stamps) in checked:
                continue
            checked.add(id(stamps))
            what = f"{self._source.path}" + (f", {column}" if self._source.timed else "")
            first, last = max(first, float(stamps.times[0])), min(last, float(stamps.times[-1]))
            check_rate(stamps, self._period, self._gap, self._columns.map.rate, what)
        if staged is not None:
            first, last = self._within_stages(staged, first, last)
        stated = self._columns.map.time
        if stated is not None and stated.start is not None:
            origin = self._assignment.origin
            begin = stated.start - origin
            if not first - NEAR * self._period <= begin < last:
                ends = f"{origin + first:.12g} s to {origin + last:.12g} s"
                message = f"the log has samples from {ends}, as its clock counts"
                raise self._columns.wrong(message, "time", "start")
            first = begin
        if last < first:
            raise InputError(f"{self._source.path}: its signals have no time in common")
        count = int(np.floor((last - first) / self._period + NEAR)) + 1
        return first, Ticks(self._period, count, self._gap)

    def _within_stages(
        self, staged: tuple[str, Vector, SampleTexts], first: float, last: float
    ) -> tuple[float, float]:
        """The time in which there is a stage; before and after it the column may say nothing."""
        column, times, words = staged
        # What a run's own log has after its end is in no stage.
        named = np.array([name not in _NO_STAGES for name in words.names])[words.codes]
        if not named.any():
            raise InputError(f"{self._source.path}: column '{column}' names no stage")
        begin, end = int(np.argmax(named)), len(named) - 1 - int(np.argmax(named[::-1]))
        if not named[begin : end + 1].all():
            place = self._assignment.place(column, begin + int(np.argmin(named[begin:])))
            raise InputError(
                f"{self._source.path}: column '{column}' names no stage in {place}, between stages"
            )
        if end < len(named) - 1:
            after = words.names[words.codes[end + 1]]
            self._after = FAIL if after == TO_REST else after
            # A message holds until the next one; a row of a table is one sample.
            until = float(times[end + 1]) - 2 * NEAR * self._period
            last = min(last, until if self._source.timed else float(times[end]))
        return max(first, float(times[begin])), last

    def _at(self, signal: Assigned, start: float, ticks: Ticks) -> Vector:
        """(ticks,) values of a signal at the ticks."""
        held = signal.name in _HELD_COLUMNS or _is_condition(signal.name)
        times = signal.times - start
        return ticks.values(times, signal.values, held=held, scaled=signal.si)

    def _as_measured(self, values: dict[str, Vector]) -> list[str]:
        """Puts measured values in the place of true ones that nobody has; returns their names."""
        taken = []
        for name in self._units:
            if name not in values and f"{name}.measured" in values:
                values[name] = values[f"{name}.measured"]
                taken.append(name)
        forces = [values.get(f"force.{axis}") for axis in TRANSLATIONS]
        if "touching" not in values and all(force is not None for force in forces):
            size = np.sqrt(sum(force**2 for force in forces if force is not None))
            values["touching"] = np.where(np.isnan(size), np.nan, size > TOUCHING)
        return taken

    # Stages.

    def _by_column(
        self, staged: tuple[str, Vector, SampleTexts], start: float, ticks: Ticks
    ) -> list[tuple[int, str]]:
        column, times, words = staged
        known = self._program.context.loaded.task.stages
        for code, word in enumerate(words.names):
            if word not in _NO_STAGES and word not in known:
                place = self._assignment.place(column, words.first(code))
                hint = suggestion(word, known, "stages")
                raise InputError(
                    f"{self._source.path}: '{word}' in column '{column}', {place}, is no stage of "
                    f"the task; {hint}; a map has names for that (stage: {{column: {column}, "
                    f"names: {{{word}: ...}}}})"
                )
        # Two words of the column may name one stage.
        distinct = list(dict.fromkeys(words.names))
        number = np.array([distinct.index(word) for word in words.names])
        since, times = self._assignment.since(), times - start
        found: list[tuple[int, str]] = []
        before, t_before = -1, -np.inf
        if since is not None:
            # A stage that follows itself shows where a run's own log counts its time anew.
            t = ticks.values(since.times - start, since.values, held=True, scaled=since.si)
        for part in blocks(ticks.count):
            stages = number[words.codes[ticks.last(times, part)]]
            begins = np.diff(stages, prepend=before) != 0
            before = int(stages[-1])
            if since is not None:
                here = np.asarray(t[part])
                begins |= np.diff(here, prepend=t_before) < -self._period / 2
                t_before = float(here[-1])
            ticks_of = np.flatnonzero(begins).tolist()
            found += [(part.start + tick, distinct[stages[tick]]) for tick in ticks_of]
        return found

    def _by_times(self, start: float, ticks: Ticks) -> list[tuple[int, str]]:
        """First tick and name of each stage; times count from the first tick, or as the log's."""
        starts = self._columns.map.stages or []
        known = self._program.context.loaded.task.stages
        for number, each in enumerate(starts):
            if each.stage in (END, FAIL) and number and each is starts[-1]:
                continue
            if each.stage not in known:
                hint = suggestion(each.stage, known, "stages")
                message = f"the task has no stage '{each.stage}'; {hint}"
                raise self._columns.wrong(message, "stages", number, "stage")
        times, begin = [each.at for each in starts], self._assignment.origin + start
        if abs(times[0] - begin) < self._period:
            times = [max(time - begin, 0.0) for time in times]
        for number, (before, after) in enumerate(pairwise(times), 1):
            if after <= before:
                message = "a stage begins after the one before it"
                raise self._columns.wrong(message, "stages", number, "at")
        if times[0] > NEAR * self._period:
            clock = f", or {begin:.12g} s as its clock counts" if begin else ""
            rest = "time.start leaves out the rest"
            message = f"the first stage begins with the log, at 0 s{clock}; {rest}"
            raise self._columns.wrong(message, "stages", 0, "at")
        firsts = [int(np.ceil(time / self._period - NEAR)) for time in times]
        for number, first in enumerate(firsts):
            if first >= ticks.count + (starts[number].stage in (END, FAIL)):
                message = f"the log ends {ticks.count * self._period:.6g} s after its beginning"
                raise self._columns.wrong(message, "stages", number, "at")
        return [(first, each.stage) for first, each in zip(firsts, starts, strict=True)]

    # Both together.

    def _history(
        self, values: dict[str, Vector], visits: Sequence[tuple[int, str]], ticks: Ticks
    ) -> History:
        """What there is, tick by tick; `t` counts from where each visit of a stage begins."""
        stages = empty(ticks.count, f"<U{max(len(name) for _, name in visits)}")
        t = empty(ticks.count, np.float64)
        firsts = [first for first, _ in visits]
        spans = list(zip(firsts, [*firsts[1:], ticks.count], visits, strict=True))
        for first, end, (_, name) in spans:
            stages[first:end] = name
            t[first:end] = counted(end - first) * self._period
        columns = {"clock": ticks.clock, "t": t}
        for name in self._units:
            if name in values:
                columns[name] = self._filled(name, values[name], spans, ticks)
        missing = frozenset(self._units) - columns.keys() - {"t"}
        return History(RecordedColumns(columns), stages, self._stated(columns), missing)

    def _filled(
        self,
        name: str,
        values: Vector,
        spans: Sequence[tuple[int, int, tuple[int, str]]],
        ticks: Ticks,
    ) -> Vector:
        """(ticks,) values of a signal with short gaps closed in each stay in a stage."""
        if not np.isnan(values).any():
            return values
        # What was measured may stand for what is true as well: the same array.
        made = empty(len(values), np.float64)
        for first, end, (_, stage) in spans:
            what = f"{self._source.path}: {name} in stage '{stage}'"
            made[first:end] = filled(values[first:end], ticks, what, sparse=_is_sparse(name))
        return made

    def _stated(self, columns: dict[str, Vector]) -> dict[str, str]:
        return {name: self._units[name] for name in columns}


#: What stays between two samples: it is counted, or one of a few.
_HELD_COLUMNS = ("limits", "residual")


def _is_sparse(name: str) -> bool:
    """Whether a signal may have no value for some time."""
    return name.endswith((".ref", "gap")) or name.startswith("error.")


def _is_condition(name: str) -> bool:
    return name in SCALARS and SCALARS[name].condition
