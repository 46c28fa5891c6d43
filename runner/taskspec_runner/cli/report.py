"""`taskspec report`: the report of a run, or the page of a comparison or a sweep, again."""

from __future__ import annotations

from pathlib import Path

import typer

from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.errors import InputError
from taskspec_runner.record.folder import as_written
from taskspec_runner.record.names import COMPARISON, SWEEP


def render_report(folder: Path) -> int:
    """Renders the page of a run's, a comparison's or a sweep's folder anew and says where it is."""
    if (folder / COMPARISON).is_file():
        return _render_comparison(folder)
    if (folder / SWEEP).is_file():
        return _render_sweep(folder)
    from taskspec_runner.report import write_report
    from taskspec_runner.runs import Run

    run = Run.load(folder)
    typer.echo(str(write_report(run)))
    return warn_of_damage(run, "the report")


def _render_comparison(folder: Path) -> int:
    from taskspec_runner.compare.comparison import read_comparison
    from taskspec_runner.compare.page import write_comparison

    with as_written(folder / COMPARISON):
        try:
            read = read_comparison(folder)
        except (OSError, ValueError, RecursionError) as error:
            raise InputError(f"cannot read {folder / COMPARISON}: {error}") from error
        typer.echo(str(write_comparison(read, folder)))
        return max(
            (warn_of_damage(run, "the page", name=law) for law, run in read.runs.items()), default=0
        )


def _render_sweep(folder: Path) -> int:
    from taskspec_runner.sweep.session import read_result, write_page

    with as_written(folder / SWEEP):
        result, read = read_result(folder)
        typer.echo(str(write_page(result, read)))
    if read.damage:
        typer.echo(f"taskspec: {read.damage}; the page shows its worlds", err=True)
    return int(bool(read.damage))
