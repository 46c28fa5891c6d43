"""The page of two runs: how they differ, and both in the same charts."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from taskspec_runner.compare.charts import charts
from taskspec_runner.compare.comparison import Comparison
from taskspec_runner.compare.overlay import Overlay, role
from taskspec_runner.compare.page import page_data, visits_of
from taskspec_runner.compare.picture import HERE as COMPARE
from taskspec_runner.compare.tracking import force_axes
from taskspec_runner.diff.difference import NAMES, Difference
from taskspec_runner.diff.sentences import largest_text, parting
from taskspec_runner.record.folder import plain
from taskspec_runner.record.whole import write_whole
from taskspec_runner.report.quantities import quantity
from taskspec_runner.report.template import part, script, template

HERE = Path(__file__).parent
Json = Mapping[str, Any]
#: Columns that are listed; the page says how many there are.
LISTED = 12
#: Statistics that are shown at once; the page unfolds the others.
_MAIN = ("rms_error", "peak")


def write_difference(difference: Difference, path: Path) -> Path:
    """Writes the page of two runs.

    Raises:
        OutputError: it cannot be written.
    """
    return write_whole(path, render(difference))


def render(difference: Difference) -> str:
    """The page as text."""
    data = difference.data
    laid = overlaid(difference)
    shown = charts(laid) if laid else []
    differ = [row for row in data["metrics"] if not row["same"]]
    return template("diff.html.j2", HERE).render(
        names=NAMES,
        runs=data["runs"],
        roles={name: role(name) for name in NAMES},
        title=" and ".join(dict.fromkeys(run["task"] or "run" for run in data["runs"].values())),
        equal=difference.equal,
        summary=headline(difference),
        parting=parting(difference.logs),
        facts=[row for row in (*data["outcome"], *data["inputs"])],
        text=_text,
        expectations=data["expectations"],
        metrics=[_metric(row) for row in differ if leads(row)],
        more_metrics=[_metric(row) for row in differ if not leads(row)],
        same_metrics=sum(row["same"] for row in data["metrics"]),
        apart=[(each, largest_text(each)) for each in difference.logs.apart[:LISTED]],
        more=max(len(difference.logs.apart) - LISTED, 0),
        only=data["log"]["only"],
        task=data["task"],
        versions=data["versions"],
        lead=laid.lead if laid else "",
        visits=visits_of(laid) if laid else [],
        charts=shown,
        data=page_data(laid, shown) if laid else {},
        style=part("report.css") + part("compare.css", COMPARE) + part("diff.css", HERE),
        script=script(),
    )


def leads(metric: Json) -> bool:
    """Whether a metric is shown at once: a main one, of a stage that both runs have."""
    return metric["statistic"] in _MAIN and metric["change"] is not None


def headline(difference: Difference) -> str:
    """What differs, in one line."""
    data = difference.data
    for name, run in zip(NAMES, difference.runs, strict=True):
        if run.damage:
            return f"{name} is damaged: {run.damage}. What is left of it is compared."
    if difference.equal:
        text = (
            "The runs are equal: inputs, outcome, expectations, metrics and every tick of the log"
        )
        return f"{text}; their versions differ." if data["versions"] else f"{text}."
    parts = {
        "task files": bool(data["task"]),
        "inputs": not _same(data["inputs"]),
        "outcomes": not _same(data["outcome"]),
        "expectations": not _same(data["expectations"]),
        "metrics": not _same(data["metrics"]),
        "logs": not difference.logs.equal,
        "versions": bool(data["versions"]),
    }
    return f"These differ: {', '.join(name for name, differs in parts.items() if differs)}."


def overlaid(difference: Difference) -> Overlay | None:
    """Both runs over each other from the start, or the one that has ticks."""
    runs = {n: r for n, r in zip(NAMES, difference.runs, strict=True) if len(r.clock)}
    if not runs:
        return None
    summaries = [{"metrics": {}, **run.summary} for run in difference.runs]
    laws = [
        {
            "law": name,
            # What has no force loop is drawn dashed and on top, as B is to be.
            "force_loop": name == NAMES[0],
            "outcome": difference.data["runs"][name]["verdict"],
            "reason": difference.data["runs"][name]["sentence"],
        }
        for name in NAMES
    ]
    comparison = Comparison({"laws": laws, "force_axes": force_axes(summaries)}, runs)
    return Overlay(comparison, next(iter(runs)), "", dict.fromkeys(runs, 0.0))


def _same(rows: Sequence[Json]) -> bool:
    return all(row["same"] for row in rows)


def _metric(row: Json) -> Json:
    cells = {key: quantity(row[key], row["unit"]) for key in ("a", "b", "change")}
    return {**row, "statistic": row["statistic"].replace("_", " "), **cells, "share": share(row)}


def share(row: Json) -> str:
    """The change of a metric's size against A, in percent, where that says something."""
    if row["change"] is None or not row["a"]:
        return ""
    percent = 100 * (abs(row["b"]) / abs(row["a"]) - 1)
    if abs(percent) >= 1000:
        return f"{abs(row['b'] / row['a']):.3g}-fold"
    return f"{percent:+.{0 if abs(percent) >= 10 else 1}f} %".replace("-", "−")


def _text(value: Any, unit: str) -> str:
    value = plain(value)
    if value in (None, ""):
        return "–"
    if isinstance(value, float):
        return f"{value:.6g} {unit}".rstrip()
    return str(value) if isinstance(value, str | int) else json.dumps(value)
