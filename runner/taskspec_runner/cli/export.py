"""`taskspec export`: the log of a run for other tools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import typer

from taskspec_runner.errors import InputError
from taskspec_runner.record.folder import LOG, MANIFEST


def export_log(folder: Path, path: Path | None, forms: Sequence[str]) -> int:
    """Writes the log of a run in some formats and says where, and whether the run is partial."""
    if not forms:
        raise InputError("name a format to export to: --csv, --parquet, --mcap or --rerun")
    if path is not None and len(forms) > 1:
        raise InputError(f"{path} can hold one format, not {len(forms)}; leave the path out")
    if not any((folder / name).is_file() for name in (LOG, MANIFEST)):
        raise InputError(f"cannot read {folder}: it is not the folder of a run")
    from taskspec_runner.export import export_run
    from taskspec_runner.report import damage

    for form in forms:
        done = export_run(folder, form, path)
        typer.echo(str(done.path))
        if done.note:
            typer.echo(f"taskspec: {done.path} is {done.note}", err=True)
    if done.extent.partial:
        typer.echo(f"taskspec: {done.extent.told}", err=True)
    if wrong := damage(folder):
        typer.echo(f"taskspec: {wrong}; what was exported is no evidence of the run", err=True)
        return 1
    return 0
