"""A run as a notebook shows it: verdict, expectations, picture."""

from __future__ import annotations

from markupsafe import Markup

from taskspec_runner.pages.html import code, element, joined
from taskspec_runner.report.overview import overview_svg
from taskspec_runner.runs import Run
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.outcome import so_far, verdict

_COLOURS = {"passed": "#14786c", "done": "#5b6675", "unfinished": "#9a6700", "undecided": "#9a6700"}


def notebook_html(run: Run) -> str:
    """A fragment of a page; its styles are its own."""
    said = verdict(run)
    whole = not so_far(run) and said.kind in ("passed", "done", "missed")
    rows = (_row(each, whole=whole) for each in run.expectations)
    report = joined(", with ", code("report.html")) if run.report is not None else None
    return element(
        "div",
        element("p", element("b", run.name or "run"), ": ", _word(said.kind), f". {said.sentence}"),
        element("table", *rows) if run.expectations else None,
        Markup(overview_svg(run)) if len(run.clock) else None,
        element("p", element("small", "in ", code(run.folder), report)),
        style="max-width: 860px; font-family: system-ui, sans-serif;",
    )


def _word(kind: str, word: str = "") -> Markup:
    """A verdict in its colour."""
    return element("b", word or kind, style=f"color: {_COLOURS.get(kind, '#c22d0f')};")


def _row(each: Judged, *, whole: bool) -> Markup:
    kind, word = ("passed", "met") if whole else ("done", "so far")
    if not each.passed:
        kind, word = ("undecided", "not recorded") if each.unrecorded else ("missed", "missed")
    name = element("b", each.name) + " " if each.name else None
    cells = (_word(kind, word), joined(name, code(each.text)), each.explanation)
    return element("tr", *(element("td", x, style="text-align: left;") for x in cells))
