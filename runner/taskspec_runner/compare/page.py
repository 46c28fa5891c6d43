"""The page of a comparison: one HTML file that needs nothing beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from markupsafe import Markup

from taskspec.text.units import FORCE
from taskspec_runner.compare.attempt import AS_WRITTEN
from taskspec_runner.compare.charts import REFERENCE, Curve, Overlaid, charts
from taskspec_runner.compare.comparison import Comparison
from taskspec_runner.compare.folder import PAGE, PICTURE
from taskspec_runner.compare.overlay import Overlay, overlay, role
from taskspec_runner.compare.picture import CUT_SHORT, HERE, counted, picture_svg, time_of
from taskspec_runner.compare.tracking import KINDS, best
from taskspec_runner.record.folder import RunFolder
from taskspec_runner.record.names import REPORT
from taskspec_runner.report.chart import tints
from taskspec_runner.report.drawn import Samples
from taskspec_runner.report.highlight import highlighted
from taskspec_runner.report.quantities import quantity
from taskspec_runner.report.template import part, script, template

Json = Mapping[str, Any]

#: Ranks that the headline names.
_PODIUM = 3
_WORDS = {"rms_error": "RMS", "max_error": "peak", "final_error": "final"}


def write_comparison(comparison: Comparison, folder: Path) -> Path:
    """Writes `compare.html` and `compare.svg` into the folder of a comparison.

    Args:
        comparison: to write.
        folder: of it, with the runs below it.

    Returns:
        The path of the page.

    Raises:
        OutputError: the folder cannot be written.
    """
    into = RunFolder(folder)
    into.write(PICTURE, picture_svg(comparison))
    return into.write(PAGE, render(comparison))


def render(comparison: Comparison) -> str:
    """The page of a comparison."""
    laid = overlay(comparison)
    shown = charts(laid) if laid else []
    summary = comparison.summary
    return template("compare.html.j2", HERE).render(
        title=summary["task"],
        about=summary.get("about") or "",
        outcomes=counted([law["outcome"] for law in comparison.laws]),
        laws=[_law(law) for law in comparison.laws],
        report=REPORT,
        expectations=summary["expectations"],
        ranking=_ranking(comparison),
        gains=[_gains(comparison, stage) for stage in comparison.stages],
        ran=[law for law in comparison.laws if "met" in law],
        cut_short=CUT_SHORT,
        stages=[_stage(comparison, stage) for stage in comparison.stages],
        notes=summary["notes"],
        under=laid.under if laid else "",
        time=time_of(laid) if laid else "",
        visits=visits_of(laid) if laid else [],
        charts=shown,
        data=page_data(laid, shown) if laid else {},
        task=highlighted(laid.leading.task) if laid else "",
        facts=list(_facts(summary)),
        picture=Markup(picture_svg(comparison)),
        style=part("report.css") + part("compare.css", HERE),
        script=script(),
    )


def _ranking(comparison: Comparison) -> list[tuple[int, str]]:
    """The laws that came first, second and third, with their ranks."""
    ranked = [(law["rank"], law["law"]) for law in comparison.laws if law.get("rank")]
    return [each for each in sorted(ranked, key=lambda each: each[0]) if each[0] <= _PODIUM]


def _gains(comparison: Comparison, stage: str) -> Json:
    """The gains of a stage beside what came of them; other values than those as written marked."""
    rows = comparison.rows(stage)
    gains = {law["law"]: law["gains"].get(stage, ()) for law in comparison.laws if law.get("gains")}
    own = {(g["name"], axis): g["value"] for g in gains.get(AS_WRITTEN, ()) for axis in g["axes"]}
    kind = next((k for k in KINDS if any(row and row[k] for row in rows.values())), "force")
    return {
        "name": stage,
        "kind": kind,
        "rows": [
            {
                "law": law,
                "role": role(law),
                "result": _cell(rows.get(law), (kind, "rms_error"), least=False),
                "gains": [
                    {
                        **gain,
                        "file": gain["origin"] == "file",
                        "differs": law != AS_WRITTEN
                        and any(own.get((gain["name"], a)) != gain["value"] for a in gain["axes"]),
                    }
                    for gain in found
                ],
            }
            for law, found in gains.items()
        ],
    }


def _law(law: Json) -> Json:
    return {
        **law,
        "role": role(law["law"]),
        "bad": law["outcome"] not in ("passed", "done", "missed"),
        "peak": quantity(law.get("peak_force"), FORCE),
    }


def _stage(comparison: Comparison, stage: str) -> Json:
    """A table of a stage: one row a law, the least value of each column marked."""
    rows = comparison.rows(stage)
    present = [k for k in KINDS if any(row and row[k] for row in rows.values())]
    columns = [
        (kind, statistic)
        for kind in present
        for statistic in _WORDS
        # What is left of a motion error at the end says nothing that its peak does not.
        if statistic != "final_error" or kind in ("force", "torque")
    ]
    leaders = {column: best(rows, *column) for column in columns}
    return {
        "name": stage,
        "axes": comparison.summary["force_axes"].get(stage) or [],
        "columns": [f"{kind} {_WORDS[statistic]}" for kind, statistic in columns],
        "rows": [
            {
                "law": law,
                "role": role(law),
                "planned": bool(row and row["planned"]),
                "duration": f"{row['duration']:.3f}" if row else "",
                "cells": [_cell(row, column, least=law in leaders[column]) for column in columns],
            }
            for law, row in rows.items()
        ],
    }


def _cell(row: Json | None, column: tuple[str, str], *, least: bool) -> Json:
    kind, statistic = column
    found = row[kind] if row else None
    value, unit = quantity(found[statistic] if found else None, KINDS[kind].dimension)
    return {"value": value, "unit": unit, "axis": found["axis"] if found else "", "least": least}


def visits_of(laid: Overlay) -> list[Json]:
    """The leading run's visits of stages, on the common time."""
    run = laid.leading
    return [
        {"label": run.label(v), "tint": tints(run)[v.stage], "start": start, "end": end}
        for v, start, end in laid.visits()
    ]


def page_data(laid: Overlay, shown: list[Overlaid]) -> Json:
    """What the page's script draws, as in the report of a run."""
    visits, samples = visits_of(laid), Samples()
    drawn = {chart.key: _chart(laid, chart, samples) for chart in shown}
    return {
        "samples": samples.data(),
        "start": laid.start,
        "period": laid.leading.period,
        "end": laid.end,
        "linked": True,
        "stages": [{**v, "name": v["label"]} for v in visits],
        "events": list(_events(laid)),
        "charts": drawn,
    }


def _events(laid: Overlay) -> Iterator[Json]:
    for visit, _, end in laid.visits():
        why = str(visit.ended_by.get("text") or "")
        sentence = f"{laid.lead}: {visit.stage} ends{f', {why}' if why else ''}"
        yield {"at": end, "kind": "event", "text": sentence}
    for law in laid.comparison.laws:
        run = laid.runs.get(law["law"])
        if run is not None and law["outcome"] in CUT_SHORT:
            text = f"{law['law']} {law['outcome']}: {law['reason']}"
            yield {"at": laid.begins[law["law"]] + run.end, "kind": "stop", "text": text}


def _chart(laid: Overlay, chart: Overlaid, samples: Samples) -> Json:
    begin = laid.begins[laid.lead]
    moved = [replace(b, start=b.start + begin, end=b.end + begin) for b in chart.bands]
    return {
        "unit": chart.unit,
        "log": chart.log,
        "levels": [],
        "moments": [],
        "always": [],
        "traces": [_trace(laid, curve, samples) for curve in chart.curves],
        # Whether an expectation was met differs between the laws; see the table.
        "bands": [{**asdict(band), "passed": None} for band in moved],
    }


def _trace(laid: Overlay, curve: Curve, samples: Samples) -> Json:
    run = laid.runs[curve.law]
    start = laid.begins[curve.law] + run.start
    return {
        "label": curve.label,
        "role": curve.role,
        "style": curve.style,
        "reference_of": "",
        "own": curve.label == REFERENCE,
        "sample": samples.add(run, curve.values, continuous=False, start=start),
    }


def _facts(summary: Json) -> Iterator[tuple[str, str]]:
    yield "task", str(summary["file"])
    yield "robot", str(summary.get("robot") or "")
    yield "seed", str(summary["seed"])
    yield "overrides", ", ".join(summary["overrides"]) or "–"
