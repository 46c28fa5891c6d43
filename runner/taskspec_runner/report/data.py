"""What a run folder holds, read with patience: every part of it may be missing or cut short."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Json = Mapping[str, Any]


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
class Expectation:
    """A judged expectation.

    Attributes:
        text: as written. passed: whether it held. explanation: in numbers.
        stage: it is about, None for the whole run. signal: it bounds, None if it has no plain one.
        band: lowest and highest value [SI], None on an open side; None if it is no band.
    """

    text: str
    passed: bool
    explanation: str
    stage: str | None
    signal: str | None
    band: tuple[float | None, float | None] | None


@dataclass(frozen=True, slots=True)
class Run:
    """A run folder in memory.

    Attributes:
        task: text of the task file. summary, manifest: as read, empty where missing.
        columns: (rows,) values of the log by column name [SI]. units: by column name.
        clock: (rows,) run time [s]. breaks: rows at which another stage, or visit, begins.
        visits: in order. expectations: in order.
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

    @property
    def period(self) -> float:
        """Time between two rows of the log [s]."""
        steps = np.diff(self.clock)
        return float(np.median(steps)) if len(steps) else 1e-3

    @property
    def end(self) -> float:
        """Run time at the end of the last row [s]."""
        return float(self.clock[-1]) + self.period if len(self.clock) else 0.0

    def column(self, name: str) -> Vector | None:
        """A column with at least one finite value, else None."""
        values = self.columns.get(name)
        return values if values is not None and bool(np.isfinite(values).any()) else None

    def limit(self, name: str) -> float | None:
        """A limit of the task [SI]; the widest one where its stages differ, None without one."""
        limits = _mapping(self.summary.get("limits"))
        found = [number(limits.get(name))]
        found += [number(part.get(name)) for part in limits.values() if isinstance(part, Mapping)]
        return max((value for value in found if value is not None), default=None)


def read_run(folder: Path) -> Run:
    """Reads a run folder.

    Args:
        folder: with task.yaml, summary.json, manifest.json and log.arrow, each optional.
    """
    columns, units = read_log(folder / "log.arrow")
    stage = columns.pop("stage", np.zeros(0, dtype=object))
    clock = columns.get("clock", np.zeros(0))
    rows = len(clock)
    t = columns.get("t", np.zeros(rows))
    breaks = np.zeros(0, dtype=np.int64)
    if rows > 1:
        changed = (stage[1:] != stage[:-1]) | (t[1:] < t[:-1])
        breaks = np.flatnonzero(changed).astype(np.int64) + 1
    summary = _read_json(folder / "summary.json")
    task = folder / "task.yaml"
    run_end = float(2 * clock[-1] - clock[-2]) if rows > 1 else 0.0
    visits = _visits(summary) or _logged_visits(stage, clock, breaks, run_end)
    return Run(
        task=task.read_text(encoding="utf-8", errors="replace") if task.is_file() else "",
        summary=summary,
        manifest=_read_json(folder / "manifest.json"),
        columns=columns,
        units=units,
        clock=clock,
        breaks=breaks,
        visits=visits,
        expectations=tuple(_expectation(e) for e in _mappings(summary.get("expectations"))),
    )


def read_log(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, str]]:
    """Columns and their units of a log, up to the last complete batch of a killed run."""
    batches: list[pa.RecordBatch] = []
    try:
        with path.open("rb") as file, pa.ipc.open_stream(file) as reader:
            schema = reader.schema
            while True:
                batches.append(reader.read_next_batch())
    except StopIteration:
        pass
    except (OSError, pa.ArrowInvalid):
        if not batches:
            return {}, {}
    table = pa.Table.from_batches(batches, schema=schema)
    columns: dict[str, NDArray[Any]] = {}
    units: dict[str, str] = {}
    for each in schema:
        if each.name == "stage":
            columns["stage"] = np.array(table["stage"].to_pylist(), dtype=object)
        else:
            columns[each.name] = table[each.name].to_numpy().astype(np.float64)
            units[each.name] = (each.metadata or {}).get(b"unit", b"").decode()
    return columns, units


def number(value: object) -> float | None:
    """A finite number, else None."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)


def _read_json(path: Path) -> Json:
    try:
        return _mapping(json.loads(path.read_text(encoding="utf-8")))
    except (OSError, ValueError):
        return {}


def _mapping(value: object) -> Json:
    return value if isinstance(value, Mapping) else {}


def _mappings(value: object) -> list[Json]:
    return [v for v in value if isinstance(v, Mapping)] if isinstance(value, list) else []


def _visits(summary: Json) -> tuple[Visit, ...]:
    seen: dict[str, int] = {}
    visits = []
    for entry in _mappings(summary.get("stages")):
        start, end = number(entry.get("start")), number(entry.get("end"))
        if start is None or end is None:
            return ()
        name = str(entry.get("name", ""))
        seen[name] = seen.get(name, 0) + 1
        law, frame = str(entry.get("law") or ""), str(entry.get("frame") or "")
        ended_by = _mapping(entry.get("ended_by"))
        visits.append(Visit(name, seen[name], start, end, law, frame, ended_by))
    return tuple(visits)


def _logged_visits(
    stage: NDArray[Any], clock: Vector, breaks: NDArray[np.int64], end: float
) -> tuple[Visit, ...]:
    if not len(stage):
        return ()
    seen: dict[str, int] = {}
    visits = []
    starts = [0, *breaks.tolist()]
    ends = [*(float(clock[b]) for b in breaks), end]
    for row, until in zip(starts, ends, strict=True):
        name = str(stage[row])
        seen[name] = seen.get(name, 0) + 1
        visits.append(Visit(name, seen[name], float(clock[row]), until))
    return tuple(visits)


def _expectation(entry: Json) -> Expectation:
    band = entry.get("band")
    sides = None
    if isinstance(band, list) and len(band) == 2:
        sides = (number(band[0]), number(band[1]))
    stage, signal = entry.get("stage"), entry.get("signal")
    return Expectation(
        text=str(entry.get("text", "")),
        passed=bool(entry.get("passed")),
        explanation=str(entry.get("explanation") or ""),
        stage=str(stage) if stage else None,
        signal=str(signal) if signal else None,
        band=sides if sides not in (None, (None, None)) else None,
    )
