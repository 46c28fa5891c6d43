"""The damage of a run folder, reported beside the result: what is missing, altered or partial."""

from __future__ import annotations

import typer

from taskspec_runner.exit_codes import MISSED, WELL
from taskspec_runner.runs import Run


def warn_of_damage(run: Run, what: str = "", *, name: str = "") -> int:
    """Says on standard error whether a run is partial or damaged; the exit code that it means.

    Args:
        run: that was read.
        what: was made of it, such as `the report`.
        name: of the run, where there are several.
    """
    before = f"taskspec: {name}: " if name else "taskspec: "
    if run.extent.partial and run.extent.status:
        typer.echo(before + run.extent.text, err=True)
    for changed in run.changed:
        typer.echo(f"{before}{changed} is no longer as the run read it", err=True)
    if not run.damage:
        return WELL
    so = f"; {what} is no evidence of the run" if what else ""
    typer.echo(f"{before}{run.damage}{so}", err=True)
    return MISSED
