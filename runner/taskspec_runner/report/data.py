"""What a run folder holds, read with patience: every part of it may be missing or cut short."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from taskspec_runner.record.extent import ENDED, Extent, status_of
from taskspec_runner.record.folder import LOG, MANIFEST, SUMMARY, TASK, RunFolder
from taskspec_runner.record.history import History, read_history
from taskspec_runner.report.judged import Expectation, read_expectation
from taskspec_runner.report.values import Json, mapping, mappings, number

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Visit:
    """One stay in a stage.

    Attributes:
        stage: its name. number: 1 for the first visit. start, end: run time [s].
        law, frame: under and in which it ran, empty where unknown.
        ended_by: the event that ended it, as the summary has it.
    """

    stage: str
    number: int
    start: float
    end: float
    law: str = ""
    frame: str = ""
    ended_by: Json = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Run:
    """A run folder in memory.

    Attributes:
        task: text of the task file. summary, manifest: as read, empty where missing.
        columns: (rows,) values of the log by column name [SI]. units: by column name.
        clock: (rows,) run time [s]. breaks: rows at which another stage, or visit, begins.
        visits: in order. expectations: in order.
        damage: why the log cannot be trusted, empty if nothing is wrong with it.
    """

    task: str
    summary: Json
    manifest: Json
    columns: Mapping[str, Vector]
    units: Mapping[str, str]
    clock: Vector
    breaks: NDArray[np.int64]
    visits: tuple[Visit, ...]
    expectations: tuple[Expectation, ...]
    damage: str = ""

    @property
    def period(self) -> float:
        """Time between two rows of the log [s]."""
        steps = np.diff(self.clock)
        return float(np.median(steps)) if len(steps) else 1e-3

    @property
    def start(self) -> float:
        """Run time at the first row [s]."""
        return float(self.clock[0]) if len(self.clock) else 0.0

    @property
    def end(self) -> float:
        """Run time at the end of the last row [s]."""
        return float(self.clock[-1]) + self.period if len(self.clock) else 0.0

    def column(self, name: str) -> Vector | None:
        """A column with at least one finite value, else None."""
        values = self.columns.get(name)
        return values if values is not None and bool(np.isfinite(values).any()) else None

    @property
    def extent(self) -> Extent:
        """How much of the run there is."""
        return Extent(status_of(self.manifest, self.summary), len(self.clock), self.end)

    @property
    def robot(self) -> str:
        """Name of the robot, empty where unknown."""
        robot = self.summary.get("robot")
        return str((robot.get("name") if isinstance(robot, Mapping) else robot) or "")

    @property
    def forced(self) -> list[str]:
        """Codes of the errors in spite of which it was run."""
        codes = self.summary.get("forced")
        return [str(code) for code in codes] if isinstance(codes, list) else []

    def limit(self, name: str, stage: str) -> float | None:
        """A limit in a stage [SI], None without one."""
        own = mapping(mapping(self.summary.get("stage_limits")).get(stage))
        return number(own.get(name, mapping(self.summary.get("limits")).get(name)))


def read_run(folder: Path) -> Run:
    """Reads a run folder.

    Args:
        folder: with log, summary, manifest and task file, each of them optional.
    """
    history = _read_log(folder / LOG)
    summary = _read_json(folder / SUMMARY)
    task = folder / TASK
    firsts = [visit.first for visit in history.visits()]
    return Run(
        task=task.read_text(encoding="utf-8", errors="replace") if task.is_file() else "",
        summary=summary,
        manifest=_read_json(folder / MANIFEST),
        columns=history.columns,
        units=history.units,
        clock=history.columns.get("clock", np.zeros(0)),
        breaks=np.array(firsts[1:], dtype=np.int64),
        visits=_visits(summary) or _logged_visits(history),
        expectations=tuple(
            read_expectation(e, whole=summary.get("status") == "done")
            for e in mappings(summary.get("expectations"))
        ),
        damage=damage(folder),
    )


def damage(folder: Path) -> str:
    """What is wrong with the log of a run that has ended; empty if nothing is.

    Args:
        folder: of the run.
    """
    manifest = _read_json(folder / MANIFEST)
    if manifest.get("status") not in ENDED:
        return ""
    written = mapping(manifest.get("sha256")).get(LOG)
    try:
        found = RunFolder(folder).digest(LOG)
    except OSError as error:
        return f"{LOG} cannot be read: {error.strerror or error}"
    if found is None:
        # A run that was stopped before its first tick has none.
        return f"{LOG} is missing" if written or manifest.get("status") != "stopped" else ""
    if written and found != written:
        return f"{LOG} is not what the run wrote: its SHA-256 is not the one in {MANIFEST}"
    return ""


def _read_log(path: Path) -> History:
    try:
        return read_history(path)
    except OSError:
        return History({}, np.array([], dtype=np.str_))


def _read_json(path: Path) -> Json:
    try:
        return mapping(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}


def _visits(summary: Json) -> tuple[Visit, ...]:
    seen: dict[str, int] = {}
    visits = []
    for entry in mappings(summary.get("stages")):
        start, end = number(entry.get("start")), number(entry.get("end"))
        if start is None or end is None:
            return ()
        name = str(entry.get("name", ""))
        seen[name] = seen.get(name, 0) + 1
        law, frame = str(entry.get("law") or ""), str(entry.get("frame") or "")
        ended_by = mapping(entry.get("ended_by"))
        visits.append(Visit(name, seen[name], start, end, law, frame, ended_by))
    return tuple(visits)


def _logged_visits(history: History) -> tuple[Visit, ...]:
    clock = history.columns.get("clock", np.zeros(0))
    seen: dict[str, int] = {}
    visits = []
    for each in history.visits():
        seen[each.stage] = seen.get(each.stage, 0) + 1
        after = min(each.last + 1, len(clock) - 1)
        start, end = float(clock[each.first]), float(clock[after])
        visits.append(Visit(each.stage, seen[each.stage], start, end))
    return tuple(visits)
