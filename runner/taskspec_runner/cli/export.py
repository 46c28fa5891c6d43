"""`taskspec export`: the log of a run for other tools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.errors import InputError


def export_log(
    folder: Path,
    path: Path | None,
    forms: Sequence[str],
    start: float | None = None,
    end: float | None = None,
) -> int:
    """Writes the log of a run in some formats and says where, and whether the run is partial."""
    if not forms:
        raise InputError("name a format to export to: --csv, --parquet, --mcap or --rerun")
    if path is not None and len(forms) > 1:
        raise InputError(f"{path} can hold one format, not {len(forms)}; leave the path out")
    from taskspec_runner.export import export_run
    from taskspec_runner.runs import Run

    run = Run.load(folder)

    for form in forms:
        done = export_run(run, form, path, start, end)
        typer.echo(str(done.path))
        if done.layout is not None:
            typer.echo(str(done.layout))
        if done.note:
            typer.echo(f"taskspec: {done.path} is {done.note}", err=True)
    return warn_of_damage(run, "what was exported")
