"""What the page of a sweep says, for its template."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from taskspec.program.worlds import component_dimension
from taskspec.spec import Task
from taskspec.text.units import in_unit, number, scaled
from taskspec_runner.record.names import TASK
from taskspec_runner.report.highlight import highlighted
from taskspec_runner.report.template import part, script, template
from taskspec_runner.sweep.page.columns import PEAKS, WorldColumn, columns, world_data
from taskspec_runner.sweep.page.commands import command_stem, kept_reports
from taskspec_runner.sweep.result import SweepResult
from taskspec_runner.sweep.statistics import Influence, parameters
from taskspec_runner.sweep.summary import (
    MET,
    MISSED,
    interval_text,
    rate_text,
    worst_world,
)
from taskspec_runner.sweep.world_run import Row

Json = Mapping[str, Any]

_HERE = Path(__file__).parent
_KINDS = {MET: "passed", MISSED: "missed"}
#: Parameters whose margins are drawn at once; those of others when they are asked for.
_DRAWN = 6
#: What is less likely than this is not taken for chance.
_CHANCE = 0.01


def render(result: SweepResult, said: Json) -> str:
    """The page of a sweep.

    Args:
        result: what came of it.
        said: what `sweep.json` says of it.
    """
    task, summary, rows = result.task, result.summary, result.rows
    influences = [Influence(**each) for each in summary["influences"]]
    found = columns(task, rows, influences)
    scatters = [_scatter(c, influences) for c in found if c.kind == "parameter"]
    worst = worst_world(rows)
    return template("sweep.html.j2", _HERE).render(
        title=task.name,
        about=task.about or "",
        verdicts=[_verdict(each) for each in summary["judged"]],
        success=summary["success"],
        interval=_percent(summary["success"]["interval"]),
        rate=rate_text(summary["success"]),
        ends=summary["ends"],
        counts=_counts(rows),
        expectations=[_expectation(each, rows) for each in summary["expectations"]],
        influences=[_influence(each) for each in influences],
        regions=[_region(each, found) for each in summary["regions"]],
        failed=summary["success"]["of"] - summary["success"]["good"],
        worst=None if worst is None else _worst(worst, task),
        scatters=scatters[:_DRAWN],
        more=scatters[_DRAWN:],
        map={"key": "map", "title": "Share of worlds that succeed", "unit": "%", "note": ""},
        histograms=[_figure(c, "") for c in found if c.kind == "peak" and _told(c)],
        parameters=[c for c in found if c.kind == "parameter"],
        sorts=[("world", "world"), *((c.key, c.label) for c in found if _told(c))],
        data=_data(result, said, found),
        facts=list(_facts(result, said)),
        everywhere=list(_everywhere(rows, task)),
        task=highlighted((result.path / TASK).read_text(encoding="utf-8")),
        style=part("report.css") + part("sweep.css", _HERE),
        script=script(*(part(f"{name}.js", _HERE) for name in ("worlds", "charts", "table"))),
    )


def _told(column: WorldColumn) -> bool:
    """Whether any world has a number there that is not zero."""
    return bool((abs(column.values) > 0).any())


def _verdict(each: Json) -> Json:
    return {
        "kind": _KINDS.get(each["verdict"], "undecided"),
        "word": each["verdict"],
        "text": each["text"],
        "found": rate_text(each),
        "needed": each["needed"],
        "interval": _percent(each["interval"]),
        "share": 100 * each["share"],
        "bound": 100 * each["least"],
    }


def _percent(interval: Sequence[float] | None) -> list[float] | None:
    return None if interval is None else [100 * end for end in interval]


def _counts(rows: Sequence[Row]) -> dict[str, int]:
    """How many worlds there are of each verdict, the most first."""
    found: dict[str, int] = {}
    for row in rows:
        found[row["verdict"]] = found.get(row["verdict"], 0) + 1
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _expectation(each: Json, rows: Sequence[Row]) -> Json:
    key = f"margin {each['name']}"
    judged = [row for row in rows if row["status"] == "done" and row.get(key) is not None]
    worst = min(judged, key=lambda row: row[key], default=None)
    return {
        "name": each["name"],
        "text": each["text"],
        "share": f"{100 * each['share']:.4g}" if each["of"] else "–",
        "interval": _percent(each["interval"]),
        "ends": interval_text(each),
        "worst": None if worst is None else (number(100 * worst[key], 3), worst["world"]),
    }


def _influence(each: Influence) -> Json:
    return {
        "name": each.parameter,
        "correlation": f"{each.correlation:+.2f}",
        "explained": f"{100 * each.explained:.0f}",
        "clear": each.chance < _CHANCE,
        "words": _in_words(each),
    }


def _in_words(each: Influence) -> str:
    if each.chance >= _CHANCE:
        return "no more than chance"
    if not each.one_way:
        return "not the same way everywhere"
    return "the more, the better" if each.correlation > 0 else "the less, the better"


def _scatter(column: WorldColumn, influences: Sequence[Influence]) -> Json:
    known = (each for each in influences if each.parameter == column.key)
    return _figure(column, next(map(_in_words, known), ""))


def _figure(column: WorldColumn, note: str) -> Json:
    title = column.label[0].upper() + column.label[1:] if column.kind == "peak" else column.label
    return {"key": column.key, "title": title, "unit": column.shown_unit, "note": note}


def _region(each: Json, found: Sequence[WorldColumn]) -> Json:
    """Where worlds fail, in words and as what the table is filtered by."""
    known = {column.key: column for column in found}
    terms = []
    for split in each["splits"]:
        column = known[split["parameter"]]
        value = in_unit(split["value"], column.unit) if column.unit else split["value"]
        terms.append(f"{column.key} {'>' if split['above'] else '<='} {value:.7g}")
    return {"text": each["text"], "filter": " and ".join(terms)}


def _worst(row: Row, task: Task) -> Json:
    values = [
        f"{name} = {scaled(value, component_dimension(task, name), 3)}"
        for name, value in row.items()
        if name.startswith(("world.", "robot.")) and value is not None
    ]
    return {
        "world": row["world"],
        "margin": number(100 * row["margin"], 3),
        "text": ", ".join(values),
    }


def _data(result: SweepResult, said: Json, found: Sequence[WorldColumn]) -> Json:
    drawn: dict[str, str] = {"map": "map"}
    drawn |= {c.key: "scatter" for c in found if c.kind == "parameter"}
    drawn |= {key: "histogram" for key in PEAKS}
    return {
        **world_data(result.task, result.rows),
        "columns": [each.as_data() for each in found if each.kind == "parameter" or _told(each)],
        "charts": drawn,
        "command": command_stem(said, result.path),
        "reports": kept_reports(result.path, result.rows),
    }


def _everywhere(rows: Sequence[Row], task: Task) -> Iterator[tuple[str, str]]:
    """What `truth` says of all worlds alike."""
    varying = parameters(rows)
    for name in dict.fromkeys(n for row in rows for n in row if n.startswith(("world.", "robot."))):
        value = next((row[name] for row in rows if row.get(name) is not None), None)
        if name not in varying and value is not None:
            yield name, scaled(value, component_dimension(task, name))


def _facts(result: SweepResult, said: Json) -> Iterator[tuple[str, str]]:
    worlds = said["worlds"]
    yield "task", str(said["file"] or "")
    yield "worlds", f"{worlds['count']} ({worlds['kind']})"
    yield "seed", str(worlds["seed"])
    sets = [f"{key}={value}" for key, value in said["overrides"].items()]
    yield "overrides", ", ".join(sets) or "–"
    yield "folder", str(result.path)
    yield from ((name, str(version)) for name, version in said["versions"].items())
