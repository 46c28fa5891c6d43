"""`taskspec report`: the report of a run, or the page of a comparison, again."""

from __future__ import annotations

from pathlib import Path

import typer

from taskspec_runner.compare.folder import COMPARISON
from taskspec_runner.errors import InputError


def render_report(folder: Path) -> int:
    """Renders the report of a run's folder, or of a comparison's, anew and says where it is."""
    if (folder / COMPARISON).is_file():
        return _render_comparison(folder)
    from taskspec_runner.report import write_report
    from taskspec_runner.runs import Run

    run = Run.load(folder)
    typer.echo(str(write_report(run)))
    if run.damage:
        typer.echo(f"taskspec: {run.damage}; the report is no evidence of the run", err=True)
        return 1
    if run.extent.partial:
        typer.echo(f"taskspec: {run.extent.told}", err=True)
    return 0


def _render_comparison(folder: Path) -> int:
    from taskspec_runner.compare.comparison import read_comparison
    from taskspec_runner.compare.page import write_comparison

    try:
        typer.echo(str(write_comparison(read_comparison(folder), folder)))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"cannot read {folder / COMPARISON}: {error}") from error
    return 0
