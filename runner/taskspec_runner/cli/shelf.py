"""The small commands: `schema`, `robots` and `report`."""

from __future__ import annotations

from pathlib import Path

import typer

from taskspec_runner.compare.folder import COMPARISON
from taskspec_runner.errors import InputError, OutputError


def show_schema(write: Path | None, check: Path | None) -> int:
    """Prints, writes or checks the JSON Schema of task files."""
    from taskspec.spec.schema import is_stale, schema_text

    if check is not None:
        path = _schema_file(check)
        try:
            stale = is_stale(path)
        except (OSError, UnicodeDecodeError) as error:
            raise InputError(f"cannot read {path}: {error}") from error
        if stale:
            typer.echo(f"{path} is not up to date; write it with: taskspec schema --write {check}")
        return int(stale)
    if write is None:
        typer.echo(schema_text(), nl=False)
        return 0
    path = _schema_file(write)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(schema_text(), encoding="utf-8")
    except OSError as error:
        raise OutputError.of(path, error) from error
    typer.echo(f"wrote {path}", err=True)
    return 0


def _schema_file(path: Path) -> Path:
    from taskspec.spec.schema import FILE_NAME

    return path / FILE_NAME if path.is_dir() else path


def list_robots() -> int:
    """Prints the built-in robots."""
    from rich.text import Text

    from taskspec.robot import builtin_robots
    from taskspec_runner.cli.console import show, table

    made = table("robot", "joints", "axes of the tip", "about", "figures from", indent=0)
    for robot in builtin_robots():
        cells = (robot.name, str(robot.joints), " ".join(robot.axes), robot.about, robot.source)
        made.add_row(*map(Text, cells))
    show(made)
    return 0


def render_report(folder: Path) -> int:
    """Renders the report of a run's folder, or of a comparison's, anew and says where it is."""
    if (folder / COMPARISON).is_file():
        return _render_comparison(folder)
    from taskspec_runner.report import write_report
    from taskspec_runner.runs import Run

    run = Run.load(folder)
    try:
        path = write_report(run)
    except OSError as error:
        raise OutputError.of(folder, error) from error
    typer.echo(str(path))
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
