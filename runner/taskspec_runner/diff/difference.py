"""How two runs differ, as data: inputs, outcome, expectations, metrics, logs and versions."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.spec import Limits
from taskspec.text.units import si_unit
from taskspec_runner.diff.logs import LogDifference, diff_logs
from taskspec_runner.record.fault_time import fault_times
from taskspec_runner.record.folder import mapping, mappings, number
from taskspec_runner.record.names import TASK
from taskspec_runner.runs import Run
from taskspec_runner.verdict.outcome import verdict

Json = Mapping[str, Any]

FORMAT = 1
NAMES = ("A", "B")
_STATISTICS = ("rms_error", "max_error", "final_error", "mean", "min", "max")
#: Of responses, and their units; empty for that of the signal.
_RESPONSES = {"rest": "", "overshoot": "", "settling_time": "s", "time_constant": "s"}
_PEAKS = {name: si_unit(Limits.dimension_of(name)) for name in ("force", "torque", "speed")}


@dataclass(frozen=True, slots=True)
class Difference:
    """Two runs and how they differ.

    Attributes:
        runs: A and B.
        logs: of both.
        data: the same as JSON has it, in SI; see `diff_runs`.
    """

    runs: tuple[Run, Run]
    logs: LogDifference
    data: Json

    @property
    def equal(self) -> bool:
        """Whether nothing differs but versions, the machine and the clock on the wall."""
        return bool(self.data["equal"])


def diff_runs(a: Run, b: Run) -> Difference:
    """Holds run B against run A; one that was killed is taken as far as it goes.

    Returns:
        Their difference; its `data` has `equal`, `runs`, `inputs`, `outcome`, `expectations`,
        `metrics`, `log`, `task` and `versions`.
    """
    runs = (a, b)
    logs = diff_logs(a.history, b.history)
    inputs, outcome = list(_inputs(*runs)), list(_outcome(*runs))
    expectations, metrics = _expectations(*runs), list(_metrics(*runs))
    task = _task(runs[0].task, runs[1].task)
    rows = [*inputs, *outcome, *expectations, *metrics]
    data = {
        "format": FORMAT,
        "equal": logs.equal
        and not (task or a.damage or b.damage)
        and all(row["same"] for row in rows),
        "runs": {name: _about(run) for name, run in zip(NAMES, runs, strict=True)},
        "inputs": inputs,
        "outcome": outcome,
        "expectations": expectations,
        "metrics": metrics,
        "log": _log(logs),
        "task": task,
        "versions": list(_versions(*runs)),
    }
    return Difference(runs, logs, data)


def _about(run: Run) -> Json:
    judged, extent = verdict(run), run.extent
    return {
        "folder": str(run.folder),
        "task": run.name,
        "file": run.manifest.get("file"),
        "verdict": judged.kind,
        "sentence": judged.sentence,
        "partial": extent.partial,
        "damage": run.damage,
    }


def _inputs(a: Run, b: Run) -> Iterator[Json]:
    yield _row("seed", [run.manifest.get("seed") for run in (a, b)])
    worlds = [mapping(run.summary.get("world")) for run in (a, b)]
    yield _row("world", [world.get("label") or "" for world in worlds])
    true = [{e.get("path"): e.get("written") for e in mappings(w.get("differs"))} for w in worlds]
    for path in dict.fromkeys([*true[0], *true[1]]):
        values = [side.get(path) for side in true]
        yield _row(f"in truth {path}", [v[1] if isinstance(v, list) else "" for v in values])
    faults = [{each.text: each.when for each in fault_times(run.summary)} for run in (a, b)]
    for text in dict.fromkeys([*faults[0], *faults[1]]):
        yield _row(f"fault in truth, {text}", [side.get(text, "") for side in faults])
    sets = [mapping(run.manifest.get("overrides")) for run in (a, b)]
    for key in dict.fromkeys([*sets[0], *sets[1]]):
        yield _row(f"--set {key}", [side.get(key) for side in sets])


def _outcome(a: Run, b: Run) -> Iterator[Json]:
    runs = (a, b)
    ends = [mapping(run.summary.get("ending")) for run in runs]
    yield _row("status", [run.extent.status for run in runs])
    yield _row("ended by", [end.get("text") for end in ends])
    yield _row("in stage", [end.get("stage") for end in ends])
    yield _row("duration", [number(run.summary.get("duration")) for run in runs], "s")
    yield _row("ticks", [run.extent.ticks for run in runs])
    yield _row("law", [str(run.summary.get("law") or "") for run in runs])
    yield _row("robot", [run.robot for run in runs])
    yield _row("stages", [", ".join(v.stage for v in run.visits) for run in runs])


def _row(name: str, values: list[Any], unit: str = "") -> Json:
    a, b = values
    return {"name": name, "a": a, "b": b, "unit": unit, "same": a == b}


def _expectations(a: Run, b: Run) -> list[Json]:
    """Each expectation with what both made of it: the same name, else the same text, is one."""
    found: dict[tuple[str, int], dict[str, Any]] = {}
    for key, run in (("a", a), ("b", b)):
        seen: dict[str, int] = {}
        for each in run.expectations:
            own = each.name or each.text
            seen[own] = seen.get(own, 0) + 1
            named = {"name": each.name} if each.name else {}
            entry = {**named, "text": each.text, "a": None, "b": None}
            row = found.setdefault((own, seen[own]), entry)
            row[key] = {"passed": each.passed, "explanation": each.explanation}
    return [{**row, "same": row["a"] == row["b"]} for row in found.values()]


def _metrics(a: Run, b: Run) -> Iterator[Json]:
    """Each metric of each stage; one that a run does not have is None there."""
    sides = [dict(_numbers(run)) for run in (a, b)]
    for place in dict.fromkeys([*sides[0], *sides[1]]):
        stage, signal, statistic, unit = place
        x, y = (side.get(place) for side in sides)
        yield {
            "stage": stage,
            "signal": signal,
            "statistic": statistic,
            "a": x,
            "b": y,
            "unit": unit,
            "change": None if x is None or y is None else y - x,
            "same": x == y,
        }


def _numbers(run: Run) -> Iterator[tuple[tuple[str, str, str, str], float | None]]:
    metrics, peaks = mapping(run.summary.get("metrics")), mapping(run.summary.get("peaks"))
    for stage in dict.fromkeys([*metrics, *peaks]):
        for signal, values in mapping(metrics.get(stage)).items():
            unit = run.units.get(signal, "")
            for statistic in _STATISTICS:
                if statistic in mapping(values):
                    yield (stage, signal, statistic, unit), number(values[statistic])
        yield from _of_stage(run, stage)
        for name, unit in _PEAKS.items():
            if name in mapping(peaks.get(stage)):
                yield (stage, name, "peak", unit), number(peaks[stage][name])


def _of_stage(run: Run, stage: str) -> Iterator[tuple[tuple[str, str, str, str], float | None]]:
    """Responses, contact and closed forms at rest of a stage."""
    for signal, values in mapping(mapping(run.summary.get("responses")).get(stage)).items():
        for statistic, unit in _RESPONSES.items():
            found = mapping(values).get(statistic)
            yield (stage, signal, statistic, unit or run.units.get(signal, "")), number(found)
    for statistic, found in mapping(mapping(run.summary.get("contact")).get(stage)).items():
        unit = "s" if statistic == "time" else ""
        yield (stage, "contact", f"lost_{statistic}" if unit else statistic, unit), number(found)
    for signal, at in mapping(mapping(run.summary.get("rest_values")).get(stage)).items():
        unit = run.units.get(signal, "")
        yield (stage, signal, "rest_by_law", unit), number(mapping(at).get("value"))


def _log(logs: LogDifference) -> Json:
    first = None
    if logs.apart:
        one = logs.apart[0]
        first = {
            "tick": one.tick,
            "clock": one.clock,
            "stages": dict(zip(NAMES, logs.stages, strict=True)),
            "columns": [
                {"name": c.name, "unit": c.unit, "a": c.values[0], "b": c.values[1]}
                for c in logs.first
            ],
        }
    return {
        "equal": logs.equal,
        "ticks": list(logs.ticks),
        "first": first,
        "apart": [
            {"name": c.name, "unit": c.unit, "tick": c.tick, "clock": c.clock,
             "largest": c.largest, "at": c.at}
            for c in logs.apart
        ],
        "only": dict(zip(NAMES, logs.only, strict=True)),
    }  # fmt: skip


def _task(a: str, b: str) -> list[str]:
    """The lines of a unified diff of the two task files, with one line around each change."""
    names = [f"{name}/{TASK}" for name in NAMES]
    return list(
        difflib.unified_diff(a.splitlines(), b.splitlines(), names[0], names[1], "", "", 1, "")
    )


def _versions(a: Run, b: Run) -> Iterator[Json]:
    sides = [mapping(run.manifest.get("versions")) for run in (a, b)]
    for name in dict.fromkeys([*sides[0], *sides[1]]):
        if sides[0].get(name) != sides[1].get(name):
            yield {"name": name, "a": sides[0].get(name), "b": sides[1].get(name)}
