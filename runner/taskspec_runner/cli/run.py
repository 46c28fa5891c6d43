"""`taskspec run`: a task in simulation, from its file to an exit code."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from taskspec.text.diagnostic import Diagnostic, Diagnostics, SpecError
from taskspec_runner.cli.diagnostics import record, show_diagnostics
from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.loading import load
from taskspec_runner.loop.interrupt import BY_SIGNAL

if TYPE_CHECKING:
    from taskspec.compiler import Program

#: The code of a stage that is predicted to be unstable in the world of its file.
UNSTABLE = "TS501"


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
    video: Path | None = None,
    force: bool = False,
) -> int:
    """Runs a task file and tells how it went; afterwards draws it as a video.

    A stage that is predicted to be unstable is not run, unless by `force`.
    """
    from taskspec.compiler import compile_task
    from taskspec_runner.cli.outcome import show_outcome
    from taskspec_runner.cli.progress import progress_line
    from taskspec_runner.loop.telemetry import read_address, sending
    from taskspec_runner.session import execute_program

    as_data = form is RunFormat.JSON
    if telemetry is not None:
        # Before anything is read or compiled.
        read_address(telemetry)
    if video is not None:
        from taskspec_runner.video.film import check_video

        check_video(video)
    try:
        program = compile_task(load(file, sets, law))
        warnings = _foreseen(program, force=force)
    except SpecError as error:
        if not as_data:
            raise
        found = {"exit_code": 1, "diagnostics": [record(d) for d in error.diagnostics]}
        _print(found)
        return 1
    loaded = program.context.loaded
    if warnings and not quiet:
        show_diagnostics(warnings, loaded.sources, err=True)
    with (
        sending(telemetry, _say) as sink,
        progress_line(shown=not quiet and sys.stderr.isatty()) as progress,
    ):
        result = execute_program(program, out, seed=seed, progress=progress, telemetry=sink)
    # Who breaks off a run does not wait for its video.
    if video is not None and result.exit_code < BY_SIGNAL:
        from taskspec_runner.cli.replay import film

        film(result.folder, video, program=program, quiet=quiet)
    if as_data:
        where = {
            "folder": str(result.folder),
            "report": str(result.report),
            "wall_seconds": result.wall_seconds,
            "real_time_factor": result.real_time_factor,
            "diagnostics": [record(d) for d in warnings],
        }
        if video is not None:
            where["video"] = str(video)
        _print({**result.summary, **where})
    else:
        show_outcome(result, quiet=quiet)
        if video is not None and not quiet and video.is_file():
            typer.echo(f"video: {video}")
    return result.exit_code


def _foreseen(program: Program, *, force: bool) -> tuple[Diagnostic, ...]:
    """What was found about a program, its predicted stability included.

    Worlds that `vary` allows are not those of a run: that one of them is unstable keeps nothing
    from running.

    Raises:
        SpecError: a stage is predicted to be unstable as it would be run, and `force` is not given.
    """
    from taskspec.check.stability.predicted import check_stability

    loaded = program.context.loaded
    found = Diagnostics(loaded.source.name)
    found.extend(program.warnings)
    check_stability(program.context, found)
    told = found.sorted()
    if force or all(d.code != UNSTABLE for d in told):
        return told
    raise SpecError([_forcible(d) if d.code == UNSTABLE else d for d in told], loaded.sources)


def _forcible(found: Diagnostic) -> Diagnostic:
    """A finding of an unstable stage with what lets it run."""
    ways = [found.hint] if found.hint else []
    return replace(found, hint="; ".join([*ways, "--force runs it all the same"]))


def _say(text: str) -> None:
    typer.echo(f"taskspec: {text}", err=True)


def _print(data: dict[str, Any]) -> None:
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
