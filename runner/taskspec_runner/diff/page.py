"""The page of two runs: how they differ, and both in the same charts."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from taskspec_runner.compare.charts import charted
from taskspec_runner.compare.overlay import Overlay, role
from taskspec_runner.compare.tracking import force_axes
from taskspec_runner.diff.difference import NAMES, Difference
from taskspec_runner.diff.sentences import largest_text, parting
from taskspec_runner.pages.document import (
    DASH,
    Cells,
    Heading,
    document,
    fold,
    head,
    in_unit,
    mark,
    named,
    note,
    outcome,
    pairs,
    right,
    seconds,
    section,
    swatch,
    table,
)
from taskspec_runner.pages.html import code, element, joined, prose
from taskspec_runner.pages.numbers import quantity
from taskspec_runner.record.folder import plain
from taskspec_runner.record.whole import write_whole

Json = Mapping[str, Any]
#: Columns that are listed; the page says how many there are.
LISTED = 12
#: Of more other metrics than this, some two pages, paper has only how many there are.
_ON_PAPER = 60
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
    data, laid = difference.data, overlaid(difference)
    runs = data["runs"]
    title = " and ".join(dict.fromkeys(run["task"] or "run" for run in runs.values()))
    script, drawn = charted(
        laid,
        ((name, run["verdict"], run["sentence"]) for name, run in runs.items()),
        "Force and motion, time since the runs began",
        "A click on a run",
    )
    kind, word = ("equal", "Equal") if difference.equal else ("differs", "Different")
    about = (
        (_name(name), joined(code(run["folder"]), " ", _outcome(run["verdict"]), ": ",
                             prose(run["sentence"])))
        for name, run in runs.items()
    )  # fmt: skip
    return document(
        f"{title}: two runs",
        head(
            "taskspec diff", title, "",
            outcome(kind, word, element("p", headline(difference))),
            pairs(about, "runs"),
            element("p", prose(parting(difference.logs)), class_="parting"),
        ),
        _expectations(data),
        *drawn,
        _facts(data),
        _task(data["task"]),
        _logs(difference),
        _metrics(data["metrics"]),
        data=script,
        scripts=("samples", "plot", "legend", "time"),
        facts=Markup(""),
    )  # fmt: skip


def _name(name: str) -> Markup:
    return joined(swatch(role(name), dashed=name == NAMES[1]), name)


def _names(look: str = "") -> list[Heading]:
    """The columns of both runs."""
    return [Heading(_name(name), look) for name in NAMES]


def _outcome(verdict: str) -> Markup:
    bad = verdict in ("missed", "failed", "stopped", "damaged")
    return element("span", verdict, class_=f"outcome {'bad' if bad else verdict}")


def _look(row: Json) -> str:
    return "same" if row["same"] else "differ"


def _expectations(data: Json) -> Markup:
    """What both runs made of each expectation."""

    def told(each: Json | None) -> object:
        if each is None:
            return "not judged"
        met = bool(each["passed"])
        sign = mark(met, ("met", "missed"))
        said = element("span", sign, class_=f"outcome {'passed' if met else 'bad'}")
        return joined(said, " ", prose(each["explanation"]))

    rows = (
        Cells(
            [named(row.get("name", ""), row["text"]), told(row["a"]), told(row["b"])],
            "same" if row["same"] else "",
        )
        for row in data["expectations"]
    )
    return section("Expectations", table(["Expected", *_names()], rows, "long"))


def _facts(data: Json) -> Markup:
    """Outcome, inputs and the versions that differ."""
    rows = [
        Cells([row["name"], *(_text(row[side], row["unit"]) for side in ("a", "b"))], _look(row))
        for row in (*data["outcome"], *data["inputs"])
    ]
    rows += [
        Cells([row["name"], row["a"] or DASH, row["b"] or DASH], "differ")
        for row in data["versions"]
    ]
    return section("Outcome", table(["", *_names()], rows, "long"))


def _task(lines: Sequence[str]) -> Markup:
    """How the task files differ."""
    looks = {"+": "plus", "-": "minus", "@": "place"}
    shown = [element("span", x or " ", class_=looks.get(x[:1], "")) for x in lines]
    return section("Task files", element("pre", *shown, class_="patch") if shown else Markup(""))


def _logs(difference: Difference) -> Markup:
    """The columns that come apart first."""
    apart, only = difference.logs.apart, difference.data["log"]["only"]
    rows = [
        [code(x.name), seconds(x.clock), largest_text(x), seconds(x.at if x.at == x.at else None)]
        for x in apart[:LISTED]
    ]
    columns = map(right, ("First differs at", "Largest difference", "at"))
    alone = (f"{name} alone has {', '.join(only[name])}." for name in NAMES if only[name])
    more = len(apart) - LISTED
    left = f"{more} more columns differ. Differences are between the same ticks of both runs."
    return section(
        "Logs",
        table(["Column", *columns], rows, "long"),
        *map(note, alone),
        note(left if more > 0 else ""),
    )


def _metrics(metrics: Sequence[Json]) -> Markup:
    """The metrics that differ, the main ones in view."""
    differ = [row for row in metrics if not row["same"]]
    main = [row for row in differ if leads(row)]
    others = [row for row in differ if not leads(row)]
    same = len(metrics) - len(differ)
    title = "Others that differ" if main else "Metrics that differ"
    long = bool(main) and len(others) > _ON_PAPER
    look = "more screen" if long else "more"
    rest = fold(title, len(others), _table_of(others), look=look) if others else Markup("")
    below = note(f"{same} others are the same." if same else "")
    if long:
        text = f"{len(others)} more differ, which unfold on the page."
        below += element("p", text, class_="empty printed")
    shown = _table_of(main) + rest
    return section("Metrics that differ", shown, below)


def _table_of(rows: Sequence[Json]) -> Markup:
    columns: list[Heading | str] = [
        "Stage",
        "Signal",
        "Metric",
        *_names("n"),
        right("Change"),
        Heading("Share", "n"),
    ]
    shown = (
        [
            row["stage"],
            code(row["signal"]),
            row["statistic"].replace("_", " "),
            *(in_unit(quantity(row[key], row["unit"])) for key in ("a", "b", "change")),
            share(row),
        ]
        for row in rows
    )
    return table(columns, shown, "long")


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
    forces = force_axes([{"metrics": {}, **run.summary} for run in difference.runs])
    return Overlay(runs, next(iter(runs)), dict.fromkeys(runs, 0.0), "", forces, NAMES[1:])


def _same(rows: Sequence[Json]) -> bool:
    return all(row["same"] for row in rows)


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
