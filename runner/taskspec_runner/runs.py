"""A run as one object: its task, its history tick by tick, and what came of it.

`taskspec_runner.run` is the function that makes one, so this module has the plural.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from taskspec.deferred import pa
from taskspec.text.characters import escaped
from taskspec.text.suggest import suggestion
from taskspec_runner.errors import InputError
from taskspec_runner.record.block import LeftTicks
from taskspec_runner.record.evidence import Evidence
from taskspec_runner.record.extent import Extent, status_of
from taskspec_runner.record.file_array import full
from taskspec_runner.record.folder import (
    Json,
    RunFolder,
    mapping,
    mappings,
    number,
    open_folder,
    plain,
)
from taskspec_runner.record.history import History, HistoryBuilder, Mask, Vector
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.lock import holder
from taskspec_runner.record.log import Log
from taskspec_runner.record.manifest import FORMAT, run_mark
from taskspec_runner.record.names import BLOCK, LOG, REPORT, SUMMARY, TASK
from taskspec_runner.record.visits import StageVisit, judged_visits, logged_visits
from taskspec_runner.signals import LoggedSignal, LoggedSignals
from taskspec_runner.verdict.judge import judge_run
from taskspec_runner.verdict.judged import Judged, read_judged
from taskspec_runner.verdict.outcome import verdict
from taskspec_runner.verdict.run_finding import RunFinding, read_finding

if TYPE_CHECKING:
    from taskspec.program.program import Program
    from taskspec.program.worlds import World
    from taskspec_runner.verdict.energy import RunEnergies

#: Rows of a log that are in memory at a time where it goes by: 8 MB at 100 columns.
ROWS = 10_000


class RebuildError(Exception):
    """The task of a run cannot be compiled again; the message says why."""


class Window:
    """Some ticks of a run."""

    def __init__(self, history: History, ticks: Mask) -> None:
        self._parts = history, ticks

    @property
    def history(self) -> History:
        """Every tick of the run."""
        return self._parts[0]

    @property
    def _ticks(self) -> Mask:
        """(rows,) which of them these are."""
        return self._parts[1]

    def __len__(self) -> int:
        return int(self._ticks.sum())

    @property
    def signals(self) -> LoggedSignals:
        """Every column of the log by its name, in SI."""
        return LoggedSignals(self.history.columns, self.history.units, self._ticks)

    @property
    def clock(self) -> LoggedSignal:
        """(n,) time since the run began [s]."""
        return self.signals["clock"]

    @property
    def stage(self) -> NDArray[np.str_]:
        """(n,) name of the stage of each tick."""
        return np.asarray(self.history.stages[self._ticks])

    def during(
        self, stage: str, start: float = 0.0, end: float = np.inf, visit: int | None = None
    ) -> Window:
        """The ticks in a stage.

        Args:
            stage: its name.
            start, end: into each visit of it [s]; `end` itself is left out.
            visit: 1 for the first visit, and so on; None for all of them.

        Raises:
            KeyError: the run never was in that stage, or not as often.
        """
        visits = [v for v in self.history.visits() if v.stage == stage]
        if not visits:
            hint = suggestion(stage, dict.fromkeys(self.history.stages.tolist()), "stages")
            raise KeyError(f"the run never was in a stage '{stage}'; {hint}".rstrip("; "))
        if visit is not None and not 1 <= visit <= len(visits):
            raise KeyError(f"stage '{stage}' has {len(visits)} visits, not a visit {visit}")
        wanted = visits if visit is None else [visits[visit - 1]]
        ticks = np.zeros(len(self.history), dtype=bool)
        for each in wanted:
            ticks[each.rows] = True
        t = self.history.columns["t"]
        return Window(self.history, self._ticks & ticks & (t >= start) & (t < end))

    def __repr__(self) -> str:
        stages = ", ".join(dict.fromkeys(self.stage.tolist()))
        return f"<{len(self)} ticks in {stages or 'no stage'}>"


class Run(Window):
    """A run that was made.

    Its parts are those that it is made with; what is not given is read from its folder when it is
    first asked for, with patience: every file of it may be missing or cut short.

    Attributes:
        folder: where everything of it is.
    """

    def __init__(
        self,
        folder: Path,
        *,
        content: bytes | None = None,
        manifest: Json | None = None,
        summary: Json | None = None,
        history: History | None = None,
        program: Program | None = None,
        damage: str | None = None,
    ) -> None:
        """A run with the parts that are at hand.

        Args:
            folder: of the run.
            content: of the task file.
            manifest, summary, history, program, damage: see there.
        """
        self.folder = folder
        parts: dict[str, object] = {"content": content, "manifest": manifest, "summary": summary}
        parts |= {"history": history, "program": program, "damage": damage}
        self.__dict__ |= {name: part for name, part in parts.items() if part is not None}

    @classmethod
    def written(
        cls,
        folder: RunFolder,
        program: Program,
        content: bytes,
        summary: Json,
        history: History,
    ) -> Self:
        """The run that a folder was just written with; nothing of it is read back.

        Args:
            folder: of the run.
            program: the compiled task.
            content: of the task file.
            summary: as it was written.
            history: of the log.
        """
        return cls(
            folder.path,
            content=content,
            manifest=plain(folder.manifest),
            summary=summary,
            history=history,
            program=program,
            damage="",
        )

    @classmethod
    def load(cls, folder: str | Path) -> Self:
        """The run of a folder; of one that was killed, what there is.

        Raises:
            InputError: it is not the folder of a run, or a newer taskspec made it.
        """
        if not RunFolder(Path(folder)).is_run:
            raise InputError(f"cannot read {folder}: it is not the folder of a run")
        run = cls(Path(folder))
        # A newer version is found out before anything is made of it.
        _ = run.manifest
        return run

    def save(self, folder: str | Path) -> Self:
        """Writes the run into another folder; an earlier run in that is replaced.

        Returns:
            The run that is there.

        Raises:
            InputError: the log is damaged, which a copy would hide.
            OutputError: the folder cannot be written.
        """
        if self.damage:
            raise InputError(f"cannot save the run in {self.folder}: {self.damage}")
        content, history = self.content, self.history
        manifest, summary = dict(self.manifest), self.summary
        folder = Path(folder)
        with open_folder(folder, folder.name) as into:
            into.write(TASK, content)
            if len(history):
                with closing(Log(into.log, keep=False, run=run_mark(manifest))) as log:
                    for batch in history.batches(ROWS):
                        log.write(batch)
                manifest["log"] = log.facts
            if summary:
                into.write_json(SUMMARY, summary)
            sums = {name: into.digest(name) for name in (TASK, LOG, SUMMARY)}
            into.note(**manifest | {"format": FORMAT, "sha256": sums})
        return type(self)(folder, content=content, summary=summary, history=history)

    @cached_property
    def evidence(self) -> Evidence:
        """Whether the files of the folder are what the run wrote."""
        return Evidence(self.folder)

    # What was to be done.

    @cached_property
    def content(self) -> bytes:
        """The task file byte by byte; empty where it is missing."""
        return self.evidence.task

    @cached_property
    def task(self) -> str:
        """Text of the task file."""
        return io.TextIOWrapper(io.BytesIO(self.content), "utf-8", errors="replace").read()

    @cached_property
    def manifest(self) -> Json:
        """The content of `manifest.json`: versions, seed, overrides, times on the wall.

        It is empty where it is missing or not as the run wrote it.
        """
        return self.evidence.manifest

    @cached_property
    def program(self) -> Program:
        """The compiled task, with the overrides of the run.

        Files that the task names, such as a robot's, are looked for beside the original task file.

        Raises:
            RebuildError: something is missing, or no longer as it was.
        """
        from taskspec.compiler import compile_unchecked
        from taskspec.spec import load_text
        from taskspec.text.diagnostic import SpecError

        if not self.content:
            raise RebuildError(f"{self.folder / TASK} is missing")
        if wrong := self.evidence.task_damage:
            raise RebuildError(wrong)
        if changed := self.evidence.changed:
            raise RebuildError(f"{', '.join(changed)} is no longer as the run read it")
        origin = self.manifest.get("file")
        file = Path(origin) if isinstance(origin, str) else self.folder / TASK
        overrides = dict(mapping(self.manifest.get("overrides")))
        try:
            return compile_unchecked(load_text(self.task, str(file), overrides, file.parent))
        except SpecError as error:
            first = error.diagnostics[0]
            raise RebuildError(f"{first.code}: {first.message}") from error
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise RebuildError(f"{type(error).__name__}: {error}") from error

    @cached_property
    def world(self) -> World:
        """What the plant was.

        Raises:
            RebuildError: the task cannot be read any more, or the manifest has no world of it.
        """
        from taskspec.program.worlds import World, true_world, world_from

        if self.link.get("measured") is True:
            return World(self.program.context.loaded.task)
        seed, said = number(self.manifest.get("seed")), mapping(self.manifest.get("world"))
        if not said:
            return true_world(self.program.context, int(seed or 0))
        try:
            return world_from(self.program.context, said, int(seed or 0))
        except (KeyError, TypeError, ValueError) as error:
            raise RebuildError(f"the manifest describes no world: {error!r}") from error

    @property
    def link(self) -> Json:
        """How plant and controller met, empty where they were one loop."""
        return mapping(self.manifest.get("link"))

    @property
    def name(self) -> str:
        """Of the task, empty where unknown."""
        return escaped(str(self.summary.get("task") or self.manifest.get("task") or ""))

    @property
    def robot(self) -> str:
        """Name of the robot, empty where unknown."""
        robot = self.summary.get("robot")
        return escaped(str((robot.get("name") if isinstance(robot, Mapping) else robot) or ""))

    @property
    def forced(self) -> list[str]:
        """Codes of the errors in spite of which it was run."""
        codes = self.summary.get("forced")
        return [str(code) for code in codes] if isinstance(codes, list) else []

    def limit(self, name: str, stage: str) -> float | None:
        """A limit in a stage [SI], None without one."""
        own = mapping(mapping(self.summary.get("stage_limits")).get(stage))
        return number(own.get(name, mapping(self.summary.get("limits")).get(name)))

    # What happened.

    @cached_property
    def history(self) -> History:
        """Every tick, up to the end of the log, or to what in it is not as the run wrote it."""
        columns = HistoryBuilder()
        try:
            for batch in self._written():
                columns.add(batch, lasting=True)
        except OSError:
            return History({}, np.array([], dtype=np.str_))
        return columns.build()

    def _written(self) -> Iterator[pa.RecordBatch]:
        """The batches on the disk, and of a killed run the ticks that came after them.

        Raises:
            OSError: there is no log, and nothing after it.
        """
        ticks, left = 0, None if self._writer else self.evidence.left
        try:
            reader = self.evidence.log()
        except OSError:
            if left is None or not len(left.rows):
                raise
        else:
            yield from reader
            ticks = reader.ticks
            if reader.damage and not reader.cut:
                return
        if left is not None and left.first <= ticks < left.first + len(left.rows):
            yield from self._recovered(left, ticks)

    def _recovered(self, left: LeftTicks, ticks: int) -> Iterator[pa.RecordBatch]:
        rows = left.rows[ticks - left.first :]
        try:
            link = self.link
            linked, measured = link.get("lock_step") is False, link.get("measured") is True
            task = self.world.task
            layout = LogLayout.of(self.program, task, linked=linked, measured=measured)
        except RebuildError as error:
            self._lost = f"{len(rows)} more lie in {BLOCK}, which needs the task: {error}"
            return
        if layout.fields != left.rows.shape[1]:
            self._lost = f"{len(rows)} more lie in {BLOCK}, which another version wrote"
            return
        try:
            yield layout.batch(rows)
        except (ValueError, IndexError, OverflowError):
            self._lost = f"{len(rows)} more lie in {BLOCK}, which are not ticks of this task"

    @cached_property
    def _writer(self) -> str:
        """The process that writes the run now, in words; empty if none does."""
        writer = holder(self.folder)
        return writer.text if writer is not None else ""

    _lost = ""

    @cached_property
    def _ticks(self) -> Mask:
        return full(len(self.history), True)

    def batches(self) -> Iterator[pa.RecordBatch]:
        """The log in order, up to some `ROWS` rows at a time; not all of it comes into memory.

        Raises:
            OSError: there is no log.
        """
        if "history" in self.__dict__:
            yield from self.history.batches(ROWS)
            return
        held: list[pa.RecordBatch] = []
        for batch in self._written():
            held.append(batch)
            if sum(b.num_rows for b in held) >= ROWS:
                yield _joined(held)
                held = []
        if held:
            yield _joined(held)

    @property
    def columns(self) -> Mapping[str, Vector]:
        """(rows,) values of the log by column name [SI]."""
        return self.history.columns

    @cached_property
    def energies(self) -> RunEnergies | None:
        """What its laws store and what changes it; None where its task cannot be read any more."""
        from taskspec_runner.verdict.energy import RunEnergies

        try:
            return RunEnergies(self.program, self.history, self.world.task)
        except RebuildError:
            return None

    @property
    def units(self) -> Mapping[str, str]:
        """Of the columns."""
        return self.history.units

    def column(self, name: str) -> Vector | None:
        """A column with at least one finite value, else None."""
        values = self.columns.get(name)
        return values if values is not None and bool(np.isfinite(values).any()) else None

    @cached_property
    def clock(self) -> LoggedSignal:
        """(rows,) run time [s]."""
        return LoggedSignal(self._clock, "clock", "s")

    @property
    def _clock(self) -> Vector:
        return self.columns.get("clock", np.zeros(0))

    @cached_property
    def period(self) -> float:
        """Time between two rows of the log [s]."""
        steps = np.diff(self._clock)
        return float(np.median(steps)) if len(steps) else 1e-3

    @property
    def start(self) -> float:
        """Run time at the first row [s]."""
        return float(self.clock[0]) if len(self.clock) else 0.0

    @property
    def end(self) -> float:
        """Run time at the end of the last row [s]."""
        return float(self.clock[-1]) + self.period if len(self.clock) else 0.0

    @cached_property
    def breaks(self) -> NDArray[np.int64]:
        """Rows at which another stage, or visit, begins."""
        firsts = [visit.first for visit in self.history.visits()]
        return np.array(firsts[1:], dtype=np.int64)

    @cached_property
    def visits(self) -> tuple[StageVisit, ...]:
        """Stays in stages, in order."""
        return judged_visits(self.summary) or logged_visits(self.history)

    @property
    def to_rest(self) -> Window | None:
        """The ticks after a run that did not come to `end`, in which its arm was brought to rest.

        They are judged by nothing and belong to no stage; None where there are none.
        """
        rest = self.history.rest
        return None if rest is None else Window(rest, full(len(rest), True))

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages that were visited, in order."""
        return tuple(visit.stage for visit in self.history.visits())

    def rows(self, visit: StageVisit) -> Mask:
        """(rows,) the rows of a visit."""
        half, clock = self.period / 2, self._clock
        return np.asanyarray((clock > visit.start - half) & (clock < visit.end - half))

    def label(self, visit: StageVisit) -> str:
        """Name of a visit; numbered where its stage was visited more than once."""
        often = sum(v.stage == visit.stage for v in self.visits) > 1
        return f"{visit.stage} {visit.number}" if often else visit.stage

    @property
    def extent(self) -> Extent:
        """How much of the run there is."""
        return self.extent_of(len(self.clock), self.end)

    def extent_of(self, ticks: int, until: float) -> Extent:
        """The same of some ticks that were read, until a run time [s]."""
        status = status_of(self.manifest, self.summary)
        return Extent(status, ticks, until, self._writer, self._lost)

    @cached_property
    def damage(self) -> str:
        """Which files or batches are missing or not as the run wrote them; empty if none is."""
        return "" if self._writer else self.evidence.damage()

    @property
    def changed(self) -> tuple[str, ...]:
        """Files that the task draws on and that are no longer as the run read them."""
        return self.evidence.changed

    # What came of it.

    @cached_property
    def summary(self) -> Json:
        """The content of `summary.json`, in SI; empty for a run that did not finish.

        It is empty, too, where it is not the one that was judged.
        """
        return self.evidence.summary

    @property
    def exit_code(self) -> int:
        """0 well, 1 missed or failed, 4 safety stop, 130 interrupted, 143 or 129 terminated."""
        return int(self.summary["exit_code"])

    @cached_property
    def expectations(self) -> tuple[Judged, ...]:
        """What the task expected and what was found, in the order of the file.

        Of a run that did not finish, they are judged on the ticks that there are.
        """
        if self.not_judged is not None:
            return self._judged_so_far
        whole = self.summary.get("status") == "done"
        entries = mappings(self.summary.get("expectations"))
        return tuple(read_judged(entry, whole=whole) for entry in entries)

    @cached_property
    def not_judged(self) -> str | None:
        """Why nothing is judged of a run that did not finish; empty if what there is was.

        None for a run that was judged when it ended.
        """
        if self.summary or self.damage or not self.extent.partial:
            return None
        if not len(self):
            return "there is no tick"
        try:
            self._judged_so_far = tuple(
                read_judged(plain(each.as_data()), whole=False)
                for each in judge_run(self.program, self.history, self.world.task)
            )
        except RebuildError as error:
            return str(error)
        return ""

    _judged_so_far: tuple[Judged, ...] = ()

    @cached_property
    def findings(self) -> tuple[RunFinding, ...]:
        """Oscillations and saturation that lasts, also those that their stages allow."""
        return tuple(read_finding(e) for e in mappings(self.summary.get("findings")))

    @property
    def faults(self) -> tuple[RunFinding, ...]:
        """The findings that their stages do not allow."""
        return tuple(each for each in self.findings if not each.allowed)

    @property
    def metrics(self) -> Mapping[str, Mapping[str, Mapping[str, float]]]:
        """Stage to signal to `rms_error`, `max_error`, `final_error`, `mean`, `min`, `max` [SI]."""
        found: Mapping[str, Mapping[str, Mapping[str, float]]] = self.summary.get("metrics", {})
        return found

    @property
    def passed(self) -> bool:
        """Whether the run came to its end and met every expectation, if there is any."""
        return self.verdict in ("passed", "done")

    @property
    def verdict(self) -> str:
        """`passed`, `done`, `missed`, `undecided`, `failed`, `stopped`, `unfinished` or `damaged`.

        `done` is a run to its end of a task that expects nothing; `undecided` is of a log from
        elsewhere, where something that decides was not recorded.
        """
        return verdict(self).kind

    @property
    def reason(self) -> str:
        """Why, in a sentence."""
        return verdict(self).sentence

    @property
    def report(self) -> Path | None:
        """The report, if there is one."""
        path = self.folder / REPORT
        return path if path.is_file() else None

    def __repr__(self) -> str:
        met = sum(each.passed is True for each in self.expectations)
        text = f"{met} of {len(self.expectations)} expectations met, {self.end:.3f} s"
        return f"<{self.name or 'run'}: {self.verdict}, {text}, in {self.folder}>"


def _joined(batches: Sequence[pa.RecordBatch]) -> pa.RecordBatch:
    return pa.Table.from_batches(batches).combine_chunks().to_batches()[0]
