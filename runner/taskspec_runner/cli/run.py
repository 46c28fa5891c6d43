"""`taskspec run`: a task in simulation, from its file to an exit code."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.findings import record, show_findings
from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.loading import load

if TYPE_CHECKING:
    from taskspec_runner.telemetry import Address, Telemetry


def run_task(
    file: Path,
    sets: Sequence[str],
    law: str | None,
    seed: int,
    out: Path | None,
    telemetry: str | None,
    *,
    quiet: bool,
    form: RunFormat,
) -> int:
    """Runs a task file and tells how it went."""
    from taskspec.compiler import compile_task
    from taskspec_runner.cli.outcome import show_outcome
    from taskspec_runner.cli.progress import progress_line
    from taskspec_runner.session import execute_program
    from taskspec_runner.telemetry import read_address

    as_data = form is RunFormat.JSON
    address = read_address(telemetry) if telemetry is not None else None
    try:
        program = compile_task(load(file, sets, law))
    except SpecError as error:
        if not as_data:
            raise
        found = {"exit_code": 1, "diagnostics": [record(d) for d in error.diagnostics]}
        _print(found)
        return 1
    loaded = program.context.loaded
    if program.warnings and not quiet:
        show_findings(program.warnings, loaded.sources, err=True)
    with (
        _sending(address) as sink,
        progress_line(shown=not quiet and sys.stderr.isatty()) as progress,
    ):
        result = execute_program(program, out, seed=seed, progress=progress, telemetry=sink)
    if as_data:
        where = {
            "folder": str(result.folder),
            "report": str(result.report),
            "wall_seconds": result.wall_seconds,
            "real_time_factor": result.real_time_factor,
            "diagnostics": [record(d) for d in program.warnings],
        }
        _print({**result.summary, **where})
    else:
        show_outcome(result, quiet=quiet)
    return result.exit_code


@contextmanager
def _sending(address: Address | None) -> Iterator[Telemetry | None]:
    """Telemetry for the time of a run; that it does not get through is said once."""
    from taskspec_runner.telemetry import Telemetry

    if address is None:
        yield None
        return
    telemetry = Telemetry(address)
    said = telemetry.trouble
    try:
        if said:
            typer.echo(f"taskspec: {said}", err=True)
        yield telemetry
    finally:
        telemetry.close()
        if telemetry.trouble != said:
            typer.echo(f"taskspec: {telemetry.trouble}", err=True)


def _print(data: dict[str, Any]) -> None:
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
