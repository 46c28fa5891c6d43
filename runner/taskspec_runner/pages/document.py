"""The pieces that pages are put together of, and the shell around them.

A piece without content is empty, so that a page names all that it may have in one expression.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from markupsafe import Markup, escape

from taskspec_runner.pages.chart import Chart
from taskspec_runner.pages.html import element, expression, highlighted, joined, small

_HERE = Path(__file__).parent
#: What stands for a number that is not there.
DASH = "–"
_SIGNS = {
    "good": "M3 8.5 6.5 12 13 4.5",
    "bad": "M4 4l8 8M12 4l-8 8",
    "undecided": "M8 2.5v7M8 13v.4",
    "done": "M4 3v10M4 4h8l-2.4 3L12 10H4",
}
_KINDS = {"passed": "good", "done": "done", "unfinished": "undecided", "undecided": "undecided"}
_FRAMES = (
    "Forces and moments are what the robot applies to the environment, in the frame of the stage."
)
_SCRIPTS = ("numbers", "svg", "chart", "save")


@dataclass(frozen=True, slots=True)
class Heading:
    """The heading of a column, and `n` for numbers or another look of its cells."""

    title: str | Markup
    look: str = ""


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell that has a look of its own, or says more under the pointer."""

    content: object
    look: str = ""
    title: str = ""


@dataclass(frozen=True, slots=True)
class Cells:
    """A row of a table, and what tells it from others."""

    cells: Sequence[object]
    look: str = ""


def right(title: str) -> Heading:
    """A column of numbers."""
    return Heading(title, "n")


def table(
    columns: Sequence[Heading | str], rows: Iterable[Cells | Sequence[object]], look: str = ""
) -> Markup:
    """A table that scrolls where it is wide, and is a list of cards on a phone.

    Args:
        columns: their headings; on a phone they stand beside each cell but the first.
        rows: without one there is no table.
        look: `judged` where the first column is a mark, and other classes of the style sheet.
    """
    heads = [c if isinstance(c, Heading) else Heading(c) for c in columns]
    body = [_row(heads, row if isinstance(row, Cells) else Cells(row)) for row in rows]
    if not body:
        return Markup("")
    shown = [element("th", c.title, class_="n" if c.look == "n" else "") for c in heads]
    if "judged" not in look:
        look = f"{look} cards".strip()
    head = element("thead", element("tr", *shown))
    return element(
        "div", element("table", head, element("tbody", *body), class_=look), class_="scroll"
    )


def _row(heads: Sequence[Heading], row: Cells) -> Markup:
    cells = []
    for i, (head, each) in enumerate(zip(heads, row.cells, strict=True)):
        cell = each if isinstance(each, Cell) else Cell(each)
        look = f"{head.look} {cell.look}".strip()
        label = escape(head.title).striptags() if i else ""
        cells.append(
            element(
                "td", cell.content, class_=look, data_label=label or None, title=cell.title or None
            )
        )
    return element("tr", *cells, class_=row.look)


def in_unit(quantity: tuple[str, str]) -> Markup:
    """A figure with its unit."""
    return joined(quantity[0], small(quantity[1]))


def seconds(value: float | None) -> str:
    """A time [s] to the millisecond."""
    return DASH if value is None else f"{value:.3f} s"


def pairs(rows: Iterable[tuple[str, object]], look: str = "") -> Markup:
    """Names with their values; those without one are left out."""
    shown = [element("div", element("dt", k), element("dd", v)) for k, v in rows if v]
    return element("dl", *shown, class_=look) if shown else Markup("")


def note(*text: object) -> Markup:
    """A sentence below what it says something of; nothing without text."""
    return element("p", *text, class_="empty") if any(text) else Markup("")


def section(title: str | Markup, first: Markup, *rest: Markup, look: str = "") -> Markup:
    """A part of a page under its heading; without its first piece there is none."""
    if not first:
        return first
    heading = element("h2", title) if title else None
    return element("section", heading, first, *rest, class_=look)


def fold(title: str, count: object, *content: object, shut: bool = True, look: str = "") -> Markup:
    """What unfolds below its title."""
    summary = element("summary", title, small(count))
    return element("details", summary, *content, class_=look, open=not shut)


def task_file(text: str) -> Markup:
    """A task file to unfold."""
    return element("section", fold("The task file", "", element("pre", highlighted(text))))


def named(name: str, text: str) -> Markup:
    """An expectation, after its name if it has one."""
    return joined(element("b", name) + " " if name else None, expression(text))


def button(text: object, look: str = "", **attributes: Any) -> Markup:
    """A button that the script of the page knows by its attributes."""
    return element("button", text, type="button", class_=look, **attributes)


def mark(good: bool, names: tuple[str, str] = ("passed", "missed")) -> Markup:
    """A tick or a cross."""
    return _sign("good" if good else "bad", names[0] if good else names[1])


def sign(kind: str) -> Markup:
    """The mark of a verdict."""
    return _sign(_KINDS.get(kind, "bad"), kind)


def _sign(shape: str, name: str) -> Markup:
    drawn = element("path", d=_SIGNS[shape])
    return element("svg", drawn, class_="mark", viewBox="0 0 16 16", role="img", aria_label=name)


def swatch(role: str, *, dashed: bool = False) -> Markup:
    """How the lines of a run are drawn."""
    line = element("path", d="M0 5H26", stroke=f"var(--{role})", stroke_width=2.4,
                   stroke_dasharray="7 3" if dashed else None)  # fmt: skip
    return element("svg", line, class_="swatch", viewBox="0 0 26 10", aria_hidden="true")


def span(
    interval: tuple[float, float] | None, share: float | None, bound: float | None = None
) -> Markup:
    """A line from 0 to 1 with an interval on it, a value, and a bound or what else it is held to.

    Args:
        interval, share, bound: of them as shares of the line; None of what there is not.
    """
    low, high = interval or (0.0, 0.0)
    whole = f"left: {100 * low:.6g}%; width: {100 * (high - low):.6g}%"
    marks = [element("b", style=f"left: {100 * (share or 0.0):.6g}%")]
    if bound is not None:
        marks.append(element("u", style=f"left: {100 * bound:.6g}%"))
    within = element("i", style=whole) if interval else None
    return element("span", within, *marks, class_="span", aria_hidden="true")


def dot(tint: object) -> Markup:
    """The colour of a stage."""
    return element("i", class_=f"dot tint{tint}")


def head(kind: str, title: str, about: str, *content: object) -> Markup:
    """The top of a page: by which command, of what, and how it came out."""
    told = element("p", about, class_="about") if about else None
    return element(
        "header", element("p", kind, class_="kind"), element("h1", title), told, *content,
        class_="top",
    )  # fmt: skip


def outcome(
    kind: str, word: object, *content: object, beside: Markup | None = None, **more: Any
) -> Markup:
    """A verdict: a word, and why; `more` attributes are as of an element."""
    parts = (element("strong", word), element("div", *content), beside)
    return element("div", *parts, class_=f"verdict {kind}", **more)


def figure(chart: Chart, look: str = "") -> Markup:
    """The place of a chart, which the script of the page draws; `low` is one of less height."""
    ways = (
        button(form.upper(), data_save=form, aria_label=f"save {chart.title} as {form.upper()}")
        for form in ("svg", "png")
    )
    caption = element(
        "figcaption",
        element("h3", chart.title, small(chart.unit)),
        element("p", chart.note, class_="note"),
        element("p", *ways, class_="save"),
        element("ul", class_="legend"),
    )
    plot = element("div", class_="plot", tabindex=0, role="group", aria_label=chart.title)
    return element("figure", caption, plot, class_=look, data_chart=chart.key)


def bar(stages: Sequence[Mapping[str, Any]], whole: str) -> Markup:
    """Buttons for the window of time of all charts: the whole of it, a stage, nearer and on."""
    help_ = "drag to zoom time or values, click twice to measure, double-click for all"
    moves = {"earlier": "‹", "out": "−", "in": "+", "later": "›"}
    names = {"out": "zoom out", "in": "zoom in"}
    windows = [button(whole, data_start="", data_end="")]
    if len(stages) > 1:
        windows += [
            button(joined(dot(s["tint"]), s["name"]), data_start=s["start"], data_end=s["end"])
            for s in stages
        ]
    zoom = (button(text, data_zoom=k, aria_label=names.get(k, k)) for k, text in moves.items())
    return element(
        "nav",
        element("div", *windows, class_="windows"),
        element("output"),
        element("span", help_, class_="help", title=help_),
        element("div", *zoom, class_="zoom"),
        class_="bar", aria_label="Time window of all charts",
    )  # fmt: skip


def patience(picture: Markup | None = None) -> Markup:
    """What stands for the charts where no script runs."""
    text = f"The charts need JavaScript{'; this picture does not' if picture else ''}."
    return element("noscript", note(text), picture)


def document(
    title: str,
    *content: object,
    data: Mapping[str, Any] | None,
    scripts: Sequence[str],
    facts: Markup,
    remark: str = "",
) -> str:
    """A page as one file that needs nothing beside it.

    Args:
        title: of the window.
        content: its pieces.
        data: what its script draws; without any the page has no script.
        scripts: names of those that draw it, beside what all share.
        facts: the foot of the page.
        remark: after the sentence there.
    """
    foot = element("footer", element("p", f"{_FRAMES} {remark}".strip()), facts)
    drawn = (_data(data), element("script", _script(scripts))) if data else ()
    page = element(
        "html",
        element(
            "head",
            element("meta", charset="utf-8"),
            element("meta", name="viewport", content="width=device-width, initial-scale=1"),
            element("meta", name="color-scheme", content="light dark"),
            element("title", title),
            element("style", part("page.css")),
        ),
        element("body", *(joined(piece, "\n") for piece in content if piece), foot, *drawn),
        lang="en",
    )
    return f"<!doctype html>\n{page}\n"


def part(name: str) -> Markup:
    """One of our own files, to be put into a page as it is."""
    return Markup((_HERE / name).read_text(encoding="utf-8"))


def _script(names: Sequence[str]) -> Markup:
    parts = "\n".join(part(f"script/{name}.js") for name in (*_SCRIPTS, *names))
    return Markup(f'(() => {{\n"use strict";\n{parts}\n}})();')


def _data(data: Mapping[str, Any]) -> Markup:
    """Data for a script, none of which ends the element that it is in."""
    text = json.dumps(data, ensure_ascii=False)
    for sign_ in "<>&":
        text = text.replace(sign_, f"\\u{ord(sign_):04x}")
    return element("script", Markup(text), type="application/json", id="run-data")
