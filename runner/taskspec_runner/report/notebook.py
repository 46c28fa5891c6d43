"""A run as a notebook shows it: verdict, expectations, picture."""

from __future__ import annotations

from markupsafe import Markup

from taskspec_runner.pages.html import code, element, joined
from taskspec_runner.report.overview import overview_svg
from taskspec_runner.runs import Run
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.outcome import so_far, verdict

_GOOD, _BAD, _OPEN, _SOFT = "#14786c", "#c22d0f", "#9a6700", "#7b8794"
_COLOURS = {"passed": _GOOD, "done": "#5b6675", "unfinished": _OPEN, "undecided": _OPEN}
_CELL = "padding: 2px 14px 2px 0; text-align: left;"


def notebook_html(run: Run) -> str:
    """A fragment of a page; its styles are its own."""
    said = verdict(run)
    whole = not so_far(run) and said.kind in ("passed", "done", "missed")
    rows = [_row(each, whole=whole) for each in run.expectations]
    table = element("table", *rows, style="border-collapse: collapse; margin: 0 0 12px;")
    colour = f"color: {_COLOURS.get(said.kind, _BAD)};"
    report = joined(", with ", code("report.html")) if run.report is not None else None
    return element(
        "div",
        element(
            "p", element("strong", run.name or "run"), ": ",
            element("strong", said.kind, style=colour), f". {said.sentence}",
            style="margin: 4px 0 10px;",
        ),
        table if rows else None,
        Markup(overview_svg(run)) if len(run.clock) else None,
        element("p", "in ", code(run.folder), report,
                style=f"margin: 8px 0; font-size: 12px; color: {_SOFT};"),
        style="max-width: 860px; font-family: system-ui, sans-serif;",
    )  # fmt: skip


def _row(each: Judged, *, whole: bool) -> Markup:
    word, colour = "met" if whole else "so far", _GOOD if whole else _SOFT
    if not each.passed:
        word, colour = ("not recorded", _OPEN) if each.unrecorded else ("missed", _BAD)
    return element(
        "tr",
        element("td", word, style=f"{_CELL} font-weight: 600; color: {colour};"),
        element("td", element("b", each.name) + " " if each.name else None, code(each.text),
                style=_CELL),
        element("td", each.explanation, style=_CELL),
        style="background: none;",
    )  # fmt: skip
