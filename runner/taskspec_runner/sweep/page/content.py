"""What the page of a sweep says, for its template."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from taskspec.program.worlds import component_dimension
from taskspec.spec import Task
from taskspec.text.units import in_unit, number, scaled
from taskspec_runner.pages.chart import Chart
from taskspec_runner.pages.document import (
    DASH,
    Cells,
    Heading,
    button,
    document,
    figure,
    fold,
    head,
    note,
    outcome,
    pairs,
    patience,
    right,
    section,
    sign,
    span,
    table,
    task_file,
)
from taskspec_runner.pages.html import code, element, expression, joined, prose
from taskspec_runner.record.names import TASK
from taskspec_runner.runs import Run
from taskspec_runner.scene.page import arm_figure, pictured
from taskspec_runner.sweep.kept import folder_of
from taskspec_runner.sweep.page.columns import PEAKS, WorldColumn, columns, world_data
from taskspec_runner.sweep.page.commands import command_stem, kept_reports
from taskspec_runner.sweep.result import SweepResult
from taskspec_runner.sweep.statistics import Influence, parameters
from taskspec_runner.sweep.summary import (
    MET,
    MISSED,
    drawn_text,
    end_of,
    interval_text,
    rate_text,
    so_far_text,
    worst_world,
    worst_worlds,
)
from taskspec_runner.sweep.world_run import Row

Json = Mapping[str, Any]

_KINDS = {MET: "passed", MISSED: "missed"}
#: Parameters whose margins are drawn at once; those of others when they are asked for.
_DRAWN = 6
#: A spread of less than this share of a value is a number, and no histogram.
_SAME = 1e-4
#: What is less likely than this is not taken for chance.
_CHANCE = 0.01
_CHOSEN = "these worlds were chosen and not drawn, so that they tell of no probability"


def render(result: SweepResult, said: Json, so_far: Markup | None = None) -> str:
    """The page of a sweep.

    Args:
        result: what came of it.
        said: what `sweep.json` says of it.
        so_far: how far it is, of one that goes on: the page then has itself loaded again.
    """
    task, rows = result.task, result.rows
    influences = [Influence(**each) for each in result.summary["influences"]]
    found = columns(task, rows, influences)
    everywhere = pairs(_everywhere(rows, task))
    facts = pairs(_facts(result, said))
    if everywhere:
        text = "In all worlds, other than in the controller's model:"
        facts = joined(facts, element("p", text), everywhere)
    return document(
        f"{task.name}: sweep",
        head(
            "taskspec sweep",
            task.name,
            task.about or "",
            so_far,
            *_verdicts(result, " so far" if so_far else ""),
            _ends(result),
        ),
        _expectations(result),
        _failures(result, found),
        _worst(result),
        _influences(influences),
        patience(),
        *_charts(found, influences),
        _worlds(result, found),
        task_file((result.path / TASK).read_text(encoding="utf-8")),
        data=_data(result, said, found),
        scripts=(
            "worlds",
            "worlds_charts",
            "copy",
            "worlds_table",
            "alone",
            "scene",
            *(["filling"] if so_far else []),
        ),
        facts=facts,
    )


def _worst(result: SweepResult) -> Markup:
    """The arm in the worst world, where its run is kept."""
    row = worst_world(result.rows)
    path = folder_of(result.path, row["world"]) if row else None
    shown = pictured(Run(path)) if path is not None and path.is_dir() else None
    if row is None or shown is None:
        return Markup("")
    how = end_of(row)
    return section("Worst world", arm_figure(shown, title=f"World {row['world']}, {how}"))


def _world(world: int, title: str | None = None) -> Markup:
    """A button that shows a world in the table."""
    return button(f"world {world}", "link", data_filter=f"world = {world}", title=title)


def _margin(margin: float, world: int, title: str | None = None) -> Markup:
    """The least margin, and the world that has it."""
    return joined(prose(f"{number(100 * margin, 3)} %"), " ", _world(world, title))


def _verdicts(result: SweepResult, until: str) -> Iterator[Markup]:
    """What the file expects of the sweep, else how many worlds succeed; `until` as a word."""
    for each in result.summary["judged"]:
        kind = _KINDS.get(each["verdict"], "undecided")
        more = [rate_text(each)]
        if each["needed"] is not None:
            more.append(f"some {each['needed']} more worlds would decide it")
        if each["interval"] is None:
            more.append(_CHOSEN)
        line = span(each["interval"], each["share"], each["least"])
        yield outcome(
            kind,
            sign(kind) + each["verdict"] + until,
            element("p", expression(each["text"]), " ", line),
            element("p", "; ".join(more), class_="rest"),
        )
    if not result.summary["judged"]:
        rate = result.summary["success"]
        share = f"{100 * rate['share']:.4g}" if rate["of"] else DASH
        about = (
            "In brackets where the probability of success is, with 95 % confidence (Wilson's "
            "interval)." if rate["interval"] else f"{_CHOSEN[0].upper()}{_CHOSEN[1:]}."
        )  # fmt: skip
        line = span(rate["interval"], rate["share"])
        yield outcome(
            "done",
            f"{share} %",
            element("p", f"succeed: {rate_text(rate)} ", line),
            element("p", about, class_="rest"),
        )


def _ends(result: SweepResult) -> Markup:
    """How many worlds came to which end, and the worst of each."""
    worst = worst_worlds(result.rows)
    found: list[tuple[str, object]] = []
    for end, count in result.summary["ends"].items():
        found.append((end, str(count)))
        if end in worst:
            row = worst[end]
            values = drawn_text(result.task, row)
            margin, world = row.get("margin"), row["world"]
            known = _world(world, values) if margin is None else _margin(margin, world, values)
            found.append((f"worst of {end}", known))
    return pairs(found, "facts")


def _expectations(result: SweepResult) -> Markup:
    """In how many worlds each was met."""
    sampled = result.summary["success"]["interval"] is not None
    columns_: list[Heading | str] = ["Expected", right("Met in"), Heading("", "spans")]
    columns_ += [right("Probability, at 95 %")] if sampled else []
    rows = []
    for each in result.summary["expectations"]:
        key = f"margin {each['name']}"
        judged = [r for r in result.rows if r["status"] == "done" and r.get(key) is not None]
        worst = min(judged, key=lambda row: row[key], default=None)
        name = element("small", each["name"], class_="which")
        share = each["share"] if each["of"] else None
        cells = [
            name + expression(each["text"]),
            joined(
                prose(f"{DASH if share is None else f'{100 * share:.4g}'} %"),
                element("small", so_far_text(each), class_="which") if each["so_far"] else "",
            ),
            span(each["interval"], share),
            *([interval_text(each)] if sampled else []),
            DASH if worst is None else _margin(worst[key], worst["world"]),
        ]
        rows.append(cells)
    return section(
        "Expectations",
        table([*columns_, right("Least margin")], rows),
        note("A margin is the share of what an expectation allows that is left: 0 % is just met, "
             "less is missed."),
    )  # fmt: skip


def _failures(result: SweepResult, found: Sequence[WorldColumn]) -> Markup:
    """Where worlds fail, as what the table is filtered by."""
    rate, known = result.summary["success"], {column.key: column for column in found}
    failed = rate["of"] - rate["good"]
    if not failed:
        text = "In no world."
    elif failed == rate["of"]:
        text = "In every world, so that nothing tells where."
    else:
        text = f"In {failed} of {rate['of']} worlds; no few bounds tell them from the others."
    items = [
        element(
            "li",
            element("span", prose(each["text"])),
            button("Show these worlds", data_filter=_filter(each, known)),
        )
        for each in result.summary["regions"]
    ]
    where = element("ul", *items, class_="regions") if items else note(text)
    return section("Where it fails", where)


def _filter(region: Json, known: Mapping[str, WorldColumn]) -> str:
    """The bounds of a region as a filter of the table, in its units."""
    terms = []
    for split in region["splits"]:
        column = known[split["parameter"]]
        value = in_unit(split["value"], column.unit) if column.unit else split["value"]
        terms.append(f"{column.key} {'>' if split['above'] else '<='} {value:.7g}")
    return " and ".join(terms)


def _influences(influences: Sequence[Influence]) -> Markup:
    """How much of the margin goes with each parameter."""
    rows = []
    for each in influences:
        explained = f"{100 * each.explained:.0f}"
        part = element("i", style=f"width: {explained}%")
        cells = [
            each.parameter,
            f"{explained} %",
            element("span", part, class_="span part", aria_hidden="true"),
            prose(f"{each.correlation:+.2f}"),
            _in_words(each),
        ]
        rows.append(Cells(cells, "" if each.chance < _CHANCE else "unclear"))
    share, trend = right("Variance explained"), right("Rank correlation")
    return section(
        "What matters",
        table(["Parameter", share, Heading("", "spans"), trend, "Direction"], rows),
        note("Of the ranks of the least margins: the share of their variance that goes with the "
             "parameter, in whatever way, and Spearman’s correlation, which sees what goes one "
             "way."),
    )  # fmt: skip


def _charts(found: Sequence[WorldColumn], influences: Sequence[Influence]) -> Iterator[Markup]:
    """Margins over each parameter, success over two, and how peaks are spread."""
    varied = [column for column in found if column.kind == "parameter"]
    words = {each.parameter: _in_words(each) for each in influences}
    drawn = [figure(_chart(column, words.get(column.key, ""))) for column in varied]
    more = drawn[_DRAWN:]
    yield section(
        "Least margin over each parameter",
        element("div", *drawn[:_DRAWN], class_="two") if drawn else Markup(""),
        fold(f"{len(more)} more parameter{'s' if len(more) != 1 else ''}", "",
             element("div", *more, class_="two"), look="more") if more else Markup(""),
        note("A point is a world: a dot succeeded, a cross did not. Those that did not come to "
             "their end have no margin and stand below. A click shows the world in the table."),
    )  # fmt: skip
    if len(varied) > 1:
        choices = [_choice(word, axis, varied, first) for word, axis, first in _AXES]
        success = Chart("map", "Share of worlds that succeed", "%", ())
        choose = element("p", *choices, class_="choose")
        title = "Success over two parameters"
        yield section(title, choose, figure(success), look="success")
    peaks = [c for c in found if c.kind == "peak" and _told(c)]
    drawn = [figure(_chart(c, "")) for c in peaks if not _alike(c)]
    place = element("div", *drawn, class_="three") if drawn else Markup("")
    same = pairs([(c.label, _of_all(c)) for c in peaks if _alike(c)], "facts")
    yield section("Largest of each world", place + same)


#: Choices of a parameter: word, axis, and which is chosen first.
_AXES = (("across", "x", 0), ("upwards", "y", 1))


def _choice(word: str, axis: str, varied: Sequence[WorldColumn], first: int) -> Markup:
    options = (
        element("option", c.label, value=c.key, selected=i == first) for i, c in enumerate(varied)
    )
    return element("label", f"{word} ", element("select", *options, data_axis=axis))


def _chart(column: WorldColumn, text: str) -> Chart:
    title = column.label[0].upper() + column.label[1:] if column.kind == "peak" else column.label
    return Chart(column.key, title, column.shown_unit, (), text)


def _worlds(result: SweepResult, found: Sequence[WorldColumn]) -> Markup:
    """The place of the table of all worlds, which the script of the page makes."""
    verdicts = [row["verdict"] for row in result.rows]
    counts = {verdict: verdicts.count(verdict) for verdict in dict.fromkeys(verdicts)}
    kinds = [button(f"all {len(verdicts)}", data_verdict="", aria_pressed="true")]
    kinds += [
        button(f"{verdict} {count}", data_verdict=verdict, aria_pressed="false")
        for verdict, count in sorted(counts.items(), key=lambda item: -item[1])
    ]
    first = next((f"{c.label} > 0 and " for c in found if c.kind == "parameter"), "")
    query = element("input", type="search", spellcheck="false", autocomplete="off",
                    autocapitalize="off", placeholder=f"{first}margin < 0")  # fmt: skip
    sorts = [("world", "world"), *((c.key, c.label) for c in found if _told(c))]
    order = element("select", *(element("option", label, value=key) for key, label in sorts))
    filter_ = element(
        "div",
        element("div", *kinds, class_="windows"),
        element("label", "Filter ", query, class_="query"),
        element("label", "Sort by ", order, class_="order"),
        button("↑", "turn", aria_label="turn the order round"),
        element("output", aria_live="polite"),
        class_="filter",
    )
    worlds = element("table", element("thead", element("tr")), class_="cards")
    place = element("div", worlds, button("More", "further"), class_="scroll list", tabindex=0,
                    role="group", aria_label="Table of worlds")  # fmt: skip
    about = note(
        "A filter is a relation such as ", code("margin < 0"), ", in the units of the table, or "
        "words that stand in a row; several are joined by ", code("and"), ". The command below a "
        "world runs it again with a log and a report.",
    )  # fmt: skip
    heading = element("h2", "Worlds", id="worlds")
    return element("section", heading, filter_, place, about, class_="worlds")


def _alike(column: WorldColumn) -> bool:
    """Whether all worlds have the same number there, to the digits that a page shows."""
    return bool(np.nanmax(column.values) - np.nanmin(column.values) < _SAME * _largest(column))


def _largest(column: WorldColumn) -> float:
    return float(np.nanmax(np.abs(column.values)))


def _of_all(column: WorldColumn) -> str:
    return f"{number(_largest(column), 4)} {column.shown_unit} in every world".replace("  ", " ")


def _told(column: WorldColumn) -> bool:
    """Whether any world has a number there that is not zero."""
    return bool((abs(column.values) > 0).any())


def _in_words(each: Influence) -> str:
    if each.chance >= _CHANCE:
        return "no more than chance"
    if not each.one_way:
        return "non-monotonic"
    return "the more, the better" if each.correlation > 0 else "the less, the better"


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
