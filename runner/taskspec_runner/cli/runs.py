"""`taskspec runs`: what lies under a folder of runs, newest first, and since when a task misses."""

from __future__ import annotations

import json
from pathlib import Path

import typer

from taskspec_runner.cli.console import show, table
from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.given import check_page
from taskspec_runner.exit_codes import WELL
from taskspec_runner.listing.kept import KeptFolder, TaskHistory, histories, kept_folders
from taskspec_runner.listing.page import margin_text, write_listing

_STYLES = {True: "green", False: "red", None: "yellow"}


def list_runs(root: Path, page: Path | None, form: RunFormat, most: int) -> int:
    """Shows the folders below `root`, and writes their page."""
    check_page(page)
    found = kept_folders(root)
    written = write_listing(root, found, page) if page is not None else None
    if form is RunFormat.JSON:
        typer.echo(json.dumps(_data(found), indent=2, ensure_ascii=False))
    elif found:
        _show(found, most)
    else:
        typer.echo(f"no runs in {root}")
    if written is not None:
        typer.echo(f"page: {written}", err=form is RunFormat.JSON)
    return WELL


def _data(found: list[KeptFolder]) -> dict[str, object]:
    misses = [
        {
            "task": each.label,
            "kind": each.kind,
            "since": since.as_data(),
            "last_good": None if each.last_good is None else each.last_good.as_data(),
        }
        for each in histories(found)
        if (since := each.misses_since) is not None
    ]
    return {"folders": [each.as_data() for each in found], "misses": misses}


def _show(found: list[KeptFolder], most: int) -> None:
    from rich.text import Text

    made = table("started", "task", "verdict", "margin", "folder", indent=0, right=("margin",))
    for each in found[:most]:
        margin = margin_text(each.margin).replace("–", "-").replace("−", "-")
        verdict = Text(each.verdict, _STYLES[each.good])
        made.add_row(Text(each.when), Text(each.label), verdict, Text(margin), Text(str(each.path)))
    show(made)
    if len(found) > most:
        typer.echo(f"and {len(found) - most} older ones; -n shows more")
    lines = [_since(each) for each in histories(found) if each.misses_since is not None]
    if lines:
        show("", *(Text(line, "red") for line in lines))


def _since(history: TaskHistory) -> str:
    since, good = history.misses_since, history.last_good
    assert since is not None
    before = f"; last good: {good.path}" if good is not None else "; none of its runs was good"
    return f"{history.label} misses since {since.when} ({since.path}){before}"
