"""The report as one HTML file that needs nothing beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from importlib import resources
from itertools import zip_longest
from pathlib import Path
from typing import Any

from markupsafe import Markup

from taskspec.compiler import Program
from taskspec_runner.given_up import told
from taskspec_runner.report import decimate, figures
from taskspec_runner.report.chart import Chart, Section, Trace
from taskspec_runner.report.data import Json, Run, Visit, number, read_run
from taskspec_runner.report.highlight import highlighted
from taskspec_runner.report.overview import overview_svg
from taskspec_runner.report.quantities import figure, quantity
from taskspec_runner.report.stages import label, tints
from taskspec_runner.report.template import part, template
from taskspec_runner.report.verdict import so_far, verdict
from taskspec_runner.video.still import still_for_report

_STATISTICS = ("mean", "min", "max", "rms", "std", "rms_error", "max_error", "final_error")


def write_report(folder: Path, program: Program | None = None) -> Path:
    """Writes `report.html` into a run folder.

    Args:
        folder: with log.arrow, summary.json, manifest.json and task.yaml; what is missing is
            left out of the report.
        program: the compiled task of the run, where that is at hand.

    Returns:
        The path of the report.

    Raises:
        OSError: the folder cannot be written.
    """
    path = folder / "report.html"
    still = still_for_report(folder, program)
    path.write_text(render(read_run(folder), still), encoding="utf-8")
    return path


def render(run: Run, still: tuple[str, float] | None = None) -> str:
    """The page of a run, with a picture of the arm at a run time [s] where there is one."""
    shown = figures.sections(run)
    return template("report.html.j2").render(
        title=_text(run.summary.get("task") or run.manifest.get("task")) or "run",
        about=_text(run.summary.get("about")),
        verdict=verdict(run),
        facts=list(_facts(run)),
        expectations=run.expectations,
        partial=verdict(run).kind not in ("passed", "missed"),
        so_far=so_far(run),
        visits=[_visit_row(run, v) for v in run.visits],
        metrics=list(_metrics(run)),
        given_up=_given_up(run),
        sections=shown,
        data=_data(run, shown),
        drawn=_drawn(run),
        task=highlighted(run.task),
        manifest=list(_flat(run.manifest)),
        picture=Markup(overview_svg(run)),
        still=still,
        style=part("report.css"),
        script=part("report.js"),
        plotly=Markup(_plotly()),
    )


def _plotly() -> str:
    bundle = resources.files("plotly") / "package_data" / "plotly.min.js"
    return bundle.read_text(encoding="utf-8")


def _data(run: Run, shown: tuple[Section, ...]) -> Json:
    """What the page's script draws."""
    tint = tints(run)
    return {
        "start": run.start,
        "period": run.period,
        "end": run.end,
        "stages": [
            {"name": label(run, v), "start": v.start, "end": v.end, "tint": tint[v.stage]}
            for v in run.visits
        ],
        "events": [
            {"at": v.end, "stopped": _stopped(v), "text": _event_text(run, v, following)}
            for v, following in zip_longest(run.visits, run.visits[1:])
            if following is not None or v.ended_by
        ],
        "charts": {chart.key: _chart(run, chart) for each in shown for chart in each.charts},
    }


def _chart(run: Run, chart: Chart) -> Json:
    return {
        "unit": chart.unit,
        "limits": [asdict(level) for level in chart.limits],
        "always": chart.always,
        "traces": [_trace(run, t) for t in chart.traces],
        "bands": [asdict(band) for band in chart.bands],
    }


def _trace(run: Run, trace: Trace) -> Json:
    rows = decimate.decimate(trace.values, run.breaks)
    values = trace.values[rows]
    if not trace.continuous:
        rows, values = decimate.broken(rows, trace.values, run.breaks)
    points = decimate.encode(rows, values)
    look = {"label": trace.label, "role": trace.role, "style": trace.style}
    return {**look, "reference_of": trace.reference_of, **points}


def _drawn(run: Run) -> str:
    rows = len(run.clock)
    told = f"{rows} ticks of {figure(1e3 * run.period)} ms"
    if rows <= decimate.POINTS:
        return f"{told}, all of them drawn."
    width = -(-2 * rows // decimate.POINTS)
    return f"{told}; of every {width} ticks the lowest and the highest value are drawn."


def _stopped(visit: Visit) -> bool:
    return visit.ended_by.get("kind") in ("limit", "stop")


def _event_text(run: Run, visit: Visit, following: Visit | None) -> str:
    to = label(run, following) if following else _text(visit.ended_by.get("to")) or "stop"
    why = _text(visit.ended_by.get("text"))
    return f"{visit.end:.3f} s: {label(run, visit)} → {to}" + (f"\n{why}" if why else "")


def _visit_row(run: Run, visit: Visit) -> Json:
    return {
        "label": label(run, visit),
        "tint": tints(run)[visit.stage],
        "visit": visit,
        "duration": visit.end - visit.start,
        "share": 1e3 * (visit.end - visit.start) / max(run.visits[-1].end, 1e-9),
        "why": _text(visit.ended_by.get("text")),
        "to": _text(visit.ended_by.get("to")),
        "bad": visit.ended_by.get("kind") not in (None, "until", "done"),
    }


def _facts(run: Run) -> Iterator[tuple[str, str]]:
    laws = dict.fromkeys(v.law for v in run.visits if v.law)
    law = _text(run.summary.get("law")) or ", ".join(laws)
    duration = number(run.summary.get("duration"))
    objects = run.summary.get("objects")
    period = number(run.summary.get("period")) or (run.period if len(run.clock) else None)
    yield "Robot", run.robot
    yield "Law", law
    yield "World", ", ".join(map(_text, objects)) if isinstance(objects, list) else ""
    yield "Duration", f"{run.end if duration is None else duration:.3f} s"
    yield "Control rate", f"{figure(1 / period, 4)} Hz" if period else ""


def _metrics(run: Run) -> Iterator[Json]:
    """Per stage: statistics as columns, signals as rows, each value in its own scale."""
    metrics = run.summary.get("metrics")
    for stage, signals in (metrics if isinstance(metrics, Mapping) else {}).items():
        if not isinstance(signals, Mapping):
            continue
        rows = {n: s for n, s in signals.items() if isinstance(s, Mapping) and s}
        seen = {key for statistics in rows.values() for key in statistics}
        columns = [key for key in _STATISTICS if key in seen] + sorted(seen - {*_STATISTICS})
        yield {
            "stage": stage,
            "tint": tints(run).get(stage, 0),
            "columns": [key.replace("_", " ") for key in columns],
            "rows": [
                (name, [quantity(number(s.get(key)), _unit(run, name)) for key in columns])
                for name, s in rows.items()
            ],
        }


def _given_up(run: Run) -> list[str]:
    """What limits and contacts took, in sentences; a summary of another version has none."""
    try:
        return list(told(run.summary))
    except (AttributeError, KeyError, TypeError, ValueError):
        return []


def _unit(run: Run, signal: str) -> str:
    return run.units.get(signal, "")


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
