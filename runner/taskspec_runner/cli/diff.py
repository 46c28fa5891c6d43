"""`taskspec diff`: how a run differs from another, as tables, as data or as a page."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from taskspec_runner.cli.console import show, table
from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.given import check_page
from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.diff.difference import NAMES, Difference, diff_runs
from taskspec_runner.diff.page import headline, leads, share, write_difference
from taskspec_runner.diff.sentences import largest_text, parting
from taskspec_runner.exit_codes import MISSED, WELL
from taskspec_runner.pages.numbers import quantity
from taskspec_runner.record.folder import plain
from taskspec_runner.runs import Run
from taskspec_runner.verdict.judged import title_of

if TYPE_CHECKING:
    from rich.table import Table

#: Columns that a terminal lists.
_COLUMNS = 6
#: What the page writes with, as a terminal of any kind shows it.
_PLAIN = str.maketrans({"−": "-", "µ": "u", "·": "*", "–": "-"})
_STYLES = {"+": "green", "-": "red", "@": "cyan"}


def diff_folders(a: Path, b: Path, page: Path | None, form: RunFormat) -> int:
    """Shows how run B differs from run A; 0 if it does not, else 1."""
    check_page(page)
    difference = diff_runs(Run.load(a), Run.load(b))
    # First, as a reader of the text may go away before its end.
    written = write_difference(difference, page) if page is not None else None
    if form is RunFormat.JSON:
        typer.echo(json.dumps(plain(difference.data), indent=2, ensure_ascii=False))
    else:
        _show(difference)
    if written is not None:
        typer.echo(f"page: {written}", err=form is RunFormat.JSON)
    shown = [
        warn_of_damage(run, name=name) for name, run in zip(NAMES, difference.runs, strict=True)
    ]
    return WELL if difference.equal and not any(shown) else MISSED


def _show(difference: Difference) -> None:
    from rich.text import Text

    data = difference.data
    for name in NAMES:
        run = data["runs"][name]
        show(Text(f"{name}  {run['folder']}: {run['verdict']}. {run['sentence']}"))
    show("", Text(headline(difference), "bold green" if difference.equal else "bold red"))
    if difference.equal:
        _section("versions", _pairs(data["versions"]), len(data["versions"]))
        return
    rows = [row for row in (*data["inputs"], *data["outcome"]) if not row["same"]]
    _section("inputs and outcome", _pairs(rows), len(rows))
    _section("versions", _pairs(data["versions"]), len(data["versions"]))
    shown = [row for row in data["expectations"] if not row["same"]]
    _section("expectations", _expectations(shown), len(shown))
    metrics = [m for m in data["metrics"] if not m["same"]]
    main = [m for m in metrics if leads(m)]
    _section("metrics", _metrics(main), len(main))
    if len(metrics) > len(main):
        left = len(metrics) - len(main)
        show(Text(f"and {left} more; --html and --format json have them", "dim"))
    apart = difference.logs.apart
    show("", Text("log", "bold"), Text(parting(difference.logs)))
    if apart:
        made = table("column", "first differs at", "largest difference", "at", indent=0,
                     right=("first differs at", "largest difference", "at"))  # fmt: skip
        for each in apart[:_COLUMNS]:
            at = "-" if each.at != each.at else f"{each.at:.3f} s"
            largest = largest_text(each).translate(_PLAIN)
            made.add_row(*map(Text, (each.name, f"{each.clock:.3f} s", largest, at)))
        show(made)
        if len(apart) > _COLUMNS:
            show(Text(f"and {len(apart) - _COLUMNS} more columns", "dim"))
    if data["task"]:
        show("", Text("task files", "bold"))
        show(*(Text(line, _STYLES.get(line[:1], "")) for line in data["task"]))


def _section(title: str, made: Table, rows: int) -> None:
    from rich.text import Text

    if rows:
        show("", Text(title, "bold"), made)


def _pairs(rows: list[Mapping[str, Any]]) -> Table:
    from rich.text import Text

    made = table("", *NAMES, indent=0)
    for row in rows:
        made.add_row(
            Text(row["name"]), *(Text(_value(row[k], row.get("unit", ""))) for k in ("a", "b"))
        )
    return made


def _value(value: Any, unit: str) -> str:
    if value in (None, ""):
        return "-"
    return f"{value:.6g} {unit}".rstrip() if isinstance(value, float) else str(value)


def _expectations(rows: list[Mapping[str, Any]]) -> Table:
    from rich.text import Text

    made = table("expected", *NAMES, indent=0)
    for row in rows:
        cells = [title_of(row)]
        for shown in (row["a"], row["b"]):
            mark = "" if shown is None else "pass" if shown["passed"] else "FAIL"
            if shown is not None and shown["passed"] is None:
                mark = "not recorded"
            cells.append("not judged" if shown is None else f"{mark}  {shown['explanation']}")
        made.add_row(*map(Text, cells))
    return made


def _metrics(rows: list[Mapping[str, Any]]) -> Table:
    from rich.text import Text

    made = table("stage", "signal", "metric", *NAMES, "change", "", indent=0,
                 right=(*NAMES, "change", ""))  # fmt: skip
    for row in rows:
        numbers = [" ".join(quantity(row[k], row["unit"])).rstrip() for k in ("a", "b", "change")]
        words = (row["stage"], row["signal"], row["statistic"].replace("_", " "))
        shown = (text.translate(_PLAIN) for text in (*numbers, share(row)))
        made.add_row(*map(Text, (*words, *shown)))
    return made
