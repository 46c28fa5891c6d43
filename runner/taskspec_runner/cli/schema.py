"""`taskspec schema`: the JSON Schema of task files."""

from __future__ import annotations

from pathlib import Path

import typer

from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.record.folder import check_target
from taskspec_runner.record.whole import write_whole


def show_schema(write: Path | None, check: Path | None) -> int:
    """Prints, writes or checks the JSON Schema of task files."""
    from taskspec.schema import is_stale, schema_text

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
    check_target(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, schema_text())
    except OSError as error:
        raise OutputError.of(path, error) from error
    typer.echo(f"wrote {path}", err=True)
    return 0


def _schema_file(path: Path) -> Path:
    from taskspec.schema import FILE_NAME

    return path / FILE_NAME if path.is_dir() else path
