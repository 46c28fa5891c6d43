"""`taskspec run`: a task in simulation, from its file to an exit code."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.diagnostics import record, show_diagnostics
from taskspec_runner.cli.formats import OutcomeFormat
from taskspec_runner.cli.loading import load
from taskspec_runner.loop.interrupt import BY_SIGNAL
from taskspec_runner.record.folder import check_folder, check_unlocked

if TYPE_CHECKING:
    from taskspec.examination import Examination
    from taskspec.program.program import Program
    from taskspec_runner.cli.testing.outcome import FileOutcome
    from taskspec_runner.runs import Run


def run_task(
    file: Path,
    sets: Sequence[str],
    law: str | None,
    seed: int,
    out: Path | None,
    telemetry: str | None,
    *,
    quiet: bool,
    form: OutcomeFormat,
    video: Path | None = None,
    force: bool = False,
    loop: str | None = None,
    world: str | None = None,
) -> int:
    """Runs a task file and tells how it went; afterwards draws it as a video."""
    from taskspec_runner.cli.outcome import show_outcome
    from taskspec_runner.cli.progress import progress_line
    from taskspec_runner.cli.testing.outcome import outcome_of, refused_by
    from taskspec_runner.loop.telemetry import read_address, sending
    from taskspec_runner.session import execute_program
    from taskspec_runner.sweep.chosen import chosen_world

    as_text, began = form is OutcomeFormat.TEXT, time.perf_counter()
    if telemetry is not None:
        # Before anything is read or compiled.
        read_address(telemetry)
    if out is not None:
        check_unlocked(out)
        check_folder(out)
    if video is not None:
        from taskspec_runner.video.film import check_video

        check_video(video)
    try:
        program = admitted(file, sets, law, force=force)
    except SpecError as error:
        if as_text:
            raise
        if form is OutcomeFormat.JSON:
            _print({"exit_code": 1, "diagnostics": [record(d) for d in error.diagnostics]})
        else:
            _report(form, refused_by(file, error))
        return 1
    if program.findings and not quiet:
        show_diagnostics(program.findings, program.context.loaded.sources, err=True)
    chosen = chosen_world(program, seed, world)
    with (
        sending(telemetry, _say) as sink,
        progress_line(shown=not quiet and sys.stderr.isatty()) as progress,
    ):
        run = execute_program(
            program, out, world=chosen, progress=progress, telemetry=sink, loop=loop
        )
    # Who breaks off a run does not wait for its video.
    if video is not None and run.exit_code < BY_SIGNAL:
        from taskspec_runner.cli.replay import film

        film(run, video, quiet=quiet)
    if as_text:
        show_outcome(run, quiet=quiet)
        if video is not None and not quiet and video.is_file():
            typer.echo(f"video: {video}")
    elif form is OutcomeFormat.JSON:
        _print(_as_data(run, program, video))
    else:
        _report(form, outcome_of(run, file, time.perf_counter() - began, str(run.report)))
    return run.exit_code


def _as_data(run: Run, program: Program, video: Path | None) -> dict[str, Any]:
    where = {
        "folder": str(run.folder),
        "report": str(run.report),
        "wall_seconds": run.manifest["wall_seconds"],
        "real_time_factor": run.manifest["real_time_factor"],
        "diagnostics": [record(d) for d in program.findings],
    }
    return {**run.summary, **where, **({} if video is None else {"video": str(video)})}


def _report(form: OutcomeFormat, outcome: FileOutcome) -> None:
    from taskspec_runner.cli.testing import github, junit

    reporter = junit if form is OutcomeFormat.JUNIT else github
    if text := reporter.report([outcome]):
        typer.echo(text)


def admitted(file: Path, sets: Sequence[str], law: str | None, *, force: bool) -> Program:
    """The program of a task file.

    Raises:
        SpecError: the task is refused; where `force` would lift that, this is said.
    """
    from taskspec.compiler import admit
    from taskspec.examination import examine

    examined = examine(load(file, sets, law))
    try:
        return admit(examined, force=force)
    except SpecError:
        if not force and _compiles(examined):
            _say("not run; --force runs it all the same")
        raise


def _compiles(examined: Examination) -> bool:
    from taskspec.compiler import admit

    try:
        admit(examined, force=True)
    except SpecError:
        return False
    return True


def _say(text: str) -> None:
    typer.echo(f"taskspec: {text}", err=True)


def _print(data: dict[str, Any]) -> None:
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
