"""The report as one HTML file that needs nothing beside it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from taskspec.program.execution.transition import FAIL
from taskspec_runner.link.link import sentence
from taskspec_runner.record.fault_time import fault_times
from taskspec_runner.record.folder import Json, mapping, mappings, number
from taskspec_runner.record.names import REPORT
from taskspec_runner.record.visits import StageVisit
from taskspec_runner.record.whole import write_whole
from taskspec_runner.report import annotated, drawn, figures, tables, to_rest
from taskspec_runner.report.chart import Chart, Section, tints
from taskspec_runner.report.overview import overview_svg
from taskspec_runner.report.quantities import figure
from taskspec_runner.report.template import part, script, template
from taskspec_runner.runs import Run
from taskspec_runner.verdict.judged import SHARE, Judged, Margin
from taskspec_runner.verdict.outcome import first_broken, is_measured, so_far, verdict
from taskspec_runner.video.still import still_for_report

#: The chart on which a limit is drawn, by its name.
_LIMITED = {
    "force": "force",
    "torque": "torque",
    "speed": "velocity",
    "deviation": "position error",
    "joint_position": "joint positions",
}
#: A look shows no more than this share of a run to either side.
_PART = 0.3
#: A look at what went wrong shows its stage so far, at least and at most so long before and after
#: it [s].
_AROUND = (0.25, 1.0)


def write_report(run: Run) -> Path:
    """Writes `report.html` into the folder of a run; what the run lacks is left out of it.

    Returns:
        The path of the report.

    Raises:
        OSError: the folder cannot be written.
    """
    return write_whole(run.folder / REPORT, render(run, still_for_report(run)))


def render(run: Run, still: tuple[str, float] | None = None) -> str:
    """The page of a run, with a picture of the arm at a run time [s] where there is one."""
    shown = to_rest.going_on(run, figures.sections(run))
    charts = {chart.key: chart for each in shown for chart in each.charts}
    main = _main(run, list(charts.values()))
    told, data = verdict(run), drawn.page_data(run, charts)
    return template("report.html.j2").render(
        title=_text(run.summary.get("task") or run.manifest.get("task")) or "run",
        about=_text(run.summary.get("about")),
        stopping=to_rest.told(run),
        recorded=bool(run.manifest.get("recorded")),
        verdict=told,
        around=_around(run),
        facts=list(_facts(run)),
        expectations=[_expectation(e) for e in sorted(run.expectations, key=_urgency)],
        partial=told.kind not in ("passed", "done", "missed"),
        findings=run.findings,
        truth=list(_truth(run)),
        faults=fault_times(run.summary),
        so_far="Judged on what there was until then." if so_far(run) else "",
        visits=[_visit_row(run, v) for v in run.visits],
        main=main,
        sections=_others(shown, main),
        given_up=tables.given_up(run),
        responses=list(tables.responses(run)),
        solver=list(tables.solver(run)),
        metrics=list(tables.tracking(run)),
        data=data,
        drawn=drawn.density(run, data),
        task=annotated.task_lines(run),
        elsewhere=annotated.elsewhere(run),
        annotated=annotated.counted(run),
        columns=_columns(run),
        manifest=list(_flat(_facts_of_manifest(run))),
        picture=Markup(overview_svg(run)),
        still=still,
        style=part("report.css"),
        script=script(),
    )


def _main(run: Run, charts: list[Chart]) -> Chart | None:
    """The chart to see first: of the limit that stopped the run, of what broke, or is expected."""
    stopped = _LIMITED.get(_text(mapping(run.summary.get("ending")).get("reason")))
    for chart in charts:
        if chart.key == stopped and run.extent.status == "stopped":
            return chart
    first = first_broken(run)
    ranked = [first] if first is not None else []
    for fault in run.faults if first is None else ():
        for chart in charts:
            if fault.signal in {trace.signal for trace in chart.traces}:
                return chart
    for each in (*ranked, *(e for e in run.expectations if e.band is not None)):
        for chart in charts:
            if each.text in _bounded(chart):
                return chart
        about = {signal.removeprefix(f"{each.stage}.") for signal in each.signals}
        about |= {each.signal} if each.signal else set()
        for chart in charts:
            if about & {trace.signal for trace in chart.traces}:
                return chart
    return charts[0] if charts else None


def _bounded(chart: Chart) -> set[str]:
    """The expectations whose bounds a chart draws."""
    return {b.text for b in chart.bands} | {t.label for t in chart.traces if t.style == "bound"}


def _others(shown: tuple[Section, ...], main: Chart | None) -> list[Section]:
    """The sections without the chart that stands first."""
    return [Section(s.title, [c for c in s.charts if c is not main], s.silent) for s in shown]


def _around(run: Run) -> tuple[float, float] | None:
    """The window in which to look for what went wrong, None if nothing did."""
    kind, first = verdict(run).kind, first_broken(run)
    if kind in ("stopped", "failed"):
        at: float | None = run.end
    elif first is None and run.faults:
        at = run.faults[0].end
    else:
        at = first.broken.clock if first is not None and first.broken else None
    if at is None:
        return None
    begun = max((v.start for v in run.visits if v.start < at), default=run.start)
    span = min(max(1.1 * (at - begun), _AROUND[0]), _AROUND[1], _PART * (run.end - run.start))
    return max(at - span, run.start), min(at + span, run.end)


def _urgency(each: Judged) -> tuple[bool, float]:
    """Sorts what was missed first, in the order in which it was broken."""
    never = 0.0 if each.passed else math.inf
    return each.passed is not False, each.broken.clock if each.broken else never


def _expectation(each: Judged) -> Json:
    return {
        "name": each.name,
        "text": each.text,
        "passed": each.passed,
        "unrecorded": each.unrecorded,
        "explanation": each.explanation,
        "broken": each.broken,
        "margins": [_margin(margin) for margin in each.margins],
    }


def _margin(margin: Margin) -> Json:
    """How far inside, with a meter of what is left of what is allowed."""
    shown = f"{figure(margin.value)} {margin.unit}".rstrip()
    if margin.name == SHARE:
        shown += " of ticks"
    if margin.left is None:
        return {"shown": shown, "left": None, "told": ""}
    told = f"{figure(100 * margin.left, 2)} % left" if margin.left >= 0 else "outside"
    return {"shown": shown, "left": round(100 * min(max(margin.left, 0.0), 1.0)), "told": told}


def _columns(run: Run) -> list[tuple[str, Json]]:
    """Signals of a log that was recorded elsewhere, and the column that each was taken from."""
    said = mapping(mapping(run.manifest.get("recorded")).get("columns"))
    return [(str(signal), mapping(column)) for signal, column in said.items()]


def _facts_of_manifest(run: Run) -> Json:
    """What stands at the foot of a page: the manifest without columns, which have a table."""
    recorded = mapping(run.manifest.get("recorded"))
    if "columns" not in recorded:
        return run.manifest
    return {**run.manifest, "recorded": {k: v for k, v in recorded.items() if k != "columns"}}


def _visit_row(run: Run, visit: StageVisit) -> Json:
    return {
        "label": run.label(visit),
        "tint": tints(run)[visit.stage],
        "visit": visit,
        "start": visit.start,
        "end": visit.end,
        "duration": visit.end - visit.start,
        "share": 1e3 * (visit.end - visit.start) / max(run.visits[-1].end, 1e-9),
        "why": _text(visit.ended_by.get("text")),
        "to": _text(visit.ended_by.get("to")),
        "bad": visit.ended_by.get("kind") not in (None, "until", "done", "recorded")
        or visit.ended_by.get("to") == FAIL,
    }


def _facts(run: Run) -> Iterator[tuple[str, str]]:
    laws = dict.fromkeys(v.law for v in run.visits if v.law)
    law = _text(run.summary.get("law")) or ", ".join(laws)
    duration = number(run.summary.get("duration"))
    objects = run.summary.get("objects")
    period = number(run.summary.get("period")) or (run.period if len(run.clock) else None)
    seed = run.manifest.get("seed", run.summary.get("seed"))
    versions = run.manifest.get("versions")
    version = versions.get("taskspec") if isinstance(versions, Mapping) else None
    yield "Robot", run.robot
    yield "Law", law
    yield "World", ", ".join(map(_text, objects)) if isinstance(objects, list) else ""
    yield "Duration", f"{run.end if duration is None else duration:.3f} s"
    yield "Control rate", f"{figure(1 / period, 4)} Hz" if period else ""
    yield "Seed", _text(seed)
    yield "Random world", _text(mapping(run.summary.get("world")).get("number"))
    yield "taskspec", _text(version)
    if "link" in run.summary:
        yield (
            "As measured" if is_measured(run) else "Driven",
            sentence(mapping(run.summary["link"])),
        )
    yield "Findings", annotated.counted(run)
    yield "Run in spite of", ", ".join(run.forced)


def _truth(run: Run) -> Iterator[tuple[str, str, str]]:
    """Where the world or the robot was not as the controller was told: what, told, true."""
    for each in mappings(mapping(run.summary.get("world")).get("differs")):
        written = each.get("written")
        if isinstance(written, list) and len(written) == 2:
            yield _text(each.get("path")), _text(written[0]), _text(written[1])


def _flat(value: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Leaves of nested data as dotted name and text."""
    if isinstance(value, Mapping):
        for key, leaf in value.items():
            yield from _flat(leaf, f"{prefix}.{key}" if prefix else str(key))
    elif isinstance(value, list):
        yield prefix, ", ".join(map(_text, value)) or "–"
    else:
        yield prefix, _text(value) or "–"


def _text(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else str(value)
