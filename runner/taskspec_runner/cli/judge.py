"""`taskspec judge`: what the log of a run comes to, and whether its summary says the same."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import typer

from taskspec_runner import exit_codes
from taskspec_runner.cli.console import show
from taskspec_runner.cli.formats import RunFormat
from taskspec_runner.cli.loading import load
from taskspec_runner.cli.outcome import expectations_table, show_outcome
from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.errors import InputError
from taskspec_runner.record.folder import (
    Json,
    check_folder,
    check_unlocked,
    mappings,
    plain,
    read_json,
)
from taskspec_runner.record.names import LOG, SUMMARY
from taskspec_runner.runs import RebuildError, Run
from taskspec_runner.verdict.findings import findings
from taskspec_runner.verdict.judge import judge_run
from taskspec_runner.verdict.judged import title_of

_OF_STATUS = {"failed": exit_codes.FAILED, "stopped": exit_codes.STOPPED}
_WORDS = {True: "met", False: "missed", None: "not judged"}


def judge_log(
    file: Path,
    log: Path,
    columns: Path | None,
    out: Path | None,
    sets: Sequence[str],
    form: RunFormat,
    *,
    quiet: bool,
) -> int:
    """Judges what was recorded elsewhere by a task file, and reports how it went.

    Returns:
        The exit code of the run; FAILED too where the log ends before the task.

    Raises:
        InputError: the log is that of a run of this project, in its folder.
    """
    if log.name == LOG or (log / LOG).is_file():
        folder = log.parent if log.name == LOG else log
        raise InputError(
            f"{log} is of a run: taskspec judge {folder} judges it by its own task; to judge it by "
            f"{file}, write its log first: taskspec export {folder} --parquet"
        )
    from taskspec_runner.recorded.judging import judge_recording

    if out is not None:
        check_unlocked(out)
        check_folder(out)
    run = judge_recording(load(file, sets), log, columns, out)
    if form is RunFormat.JSON:
        where = {"folder": str(run.folder), "report": str(run.report)}
        typer.echo(json.dumps({**run.summary, **where}, indent=2, ensure_ascii=False))
    else:
        show_outcome(run, quiet=quiet)
    return run.exit_code


def list_maps() -> int:
    """Prints the ready column maps: for which logs, from which source, what they assume."""
    from rich.padding import Padding
    from rich.text import Text

    from taskspec_runner.recorded.column_map import read_columns, ready_maps

    for name, path in ready_maps().items():
        said = read_columns(path).map
        show(Text(name, style="bold"))
        for title, text in (
            ("for", said.about),
            ("source", said.source),
            ("assumes", said.assumes),
        ):
            show(Padding(Text(f"{title}: {text}"), (0, 0, 0, 2)))
    return exit_codes.WELL


def judge_folder(folder: Path, form: RunFormat, *, recorded: bool = False) -> int:
    """Judges the log of a run again.

    Args:
        folder: of the run.
        form: of the judgement.
        recorded: whether options were given that a log from elsewhere needs.

    Returns:
        WELL if the run came to its end, met every expectation without a finding against it, and its
        summary says the same of each; else what it exited with, MISSED where only its summary says
        something else or its log is cut off.
    """
    if recorded or folder.is_file():
        raise InputError(
            f"to judge what was recorded elsewhere, name the log too: taskspec judge {folder} LOG"
        )
    run = Run.load(folder)
    wrong = run.evidence.log_damage
    if wrong or not len(run):
        raise InputError(f"cannot judge {folder}: {wrong or 'its log holds no tick'}")
    try:
        program = run.program
    except RebuildError as error:
        raise InputError(f"cannot judge {folder}: its task: {error}") from error
    judged = [plain(each.as_data()) for each in judge_run(program, run.history, run.world.task)]
    found = [plain(each.as_data()) for each in findings(program, run.history, run.world.task)]
    # What is there, also if it is not what the run wrote: that is what is to be found out.
    said = run.summary or read_json(folder / SUMMARY)
    apart = list(_apart(judged, found, said)) if said else []
    whole = not run.extent.partial and run.extent.status in ("done", "undecided")
    held = not any(each["passed"] is False for each in judged)
    held = held and all(each["allowed"] for each in found)
    open_ = run.extent.status == "undecided" or any(each["passed"] is None for each in judged)
    code = exit_codes.WELL
    if not whole:
        code = _OF_STATUS.get(run.extent.status, exit_codes.MISSED)
    elif not held or apart:
        code = exit_codes.MISSED
    elif open_:
        code = exit_codes.UNDECIDED
    if form is RunFormat.JSON:
        data = {"expectations": judged, "findings": found, "apart": apart, "damage": run.damage}
        typer.echo(json.dumps({"exit_code": code, **data}, indent=2, ensure_ascii=False))
    else:
        _show(run, judged, found, apart, whole=run.extent.status == "done", said=bool(said))
    return max(code, warn_of_damage(run))


def _show(
    run: Run,
    judged: Sequence[Json],
    found: Sequence[Json],
    apart: Sequence[str],
    *,
    whole: bool,
    said: bool,
) -> None:
    if judged:
        show(expectations_table(judged, whole=whole))
    for each in found:
        typer.echo(f"{each['stage']}: {each['text']}")
    met = sum(each["passed"] is True for each in judged)
    typer.echo(f"{run.name}: {met} of {len(judged)} expectations met, from {len(run)} ticks")
    for line in apart:
        typer.echo(f"not so in {SUMMARY}: {line}")
    if said and not apart:
        typer.echo(f"{SUMMARY} says the same")


def _apart(judged: Sequence[Json], found: Sequence[Json], said: Json) -> Iterator[str]:
    """Differences to a summary, a line each."""
    theirs = mappings(said.get("expectations"))
    for number, each in enumerate(judged):
        entry = theirs[number] if number < len(theirs) else {}
        if any(entry.get(key) != each[key] for key in ("text", "passed", "measured")):
            word = _WORDS[each["passed"]]
            yield f"`{title_of(each)}` was {word}: {each['explanation']}"
    for entry in theirs[len(judged) :]:
        yield f"`{title_of(entry)}` is not in the task"
    if mappings(said.get("findings")) != list(found):
        yield f"findings are {', '.join(each['text'] for each in found) or 'none'}"
