"""`taskspec report`: the report of a run, or the page of a comparison, again."""

from __future__ import annotations

from pathlib import Path

import typer

from taskspec_runner.cli.run_damage import warn_of_damage
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
    return warn_of_damage(run, "the report")


def _render_comparison(folder: Path) -> int:
    from taskspec_runner.compare.comparison import read_comparison
    from taskspec_runner.compare.page import write_comparison

    try:
        read = read_comparison(folder)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"cannot read {folder / COMPARISON}: {error}") from error
    typer.echo(str(write_comparison(read, folder)))
    return max(
        (warn_of_damage(run, "the page", name=law) for law, run in read.runs.items()), default=0
    )
