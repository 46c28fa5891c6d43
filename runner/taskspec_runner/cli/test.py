"""`taskspec test`: runs task files as tests, side by side, and reports what failed."""

from __future__ import annotations

import functools
import json
import time
from collections.abc import Iterable, Sequence
from contextlib import closing
from pathlib import Path

import typer

from taskspec_runner.cli.console import show
from taskspec_runner.cli.formats import OutcomeFormat
from taskspec_runner.cli.given import STDIN, changes
from taskspec_runner.cli.options import ChoiceOptions, ReportOptions, SeededOptions
from taskspec_runner.cli.parallel import in_order, processors
from taskspec_runner.cli.task_files import task_files
from taskspec_runner.cli.testing import github, junit
from taskspec_runner.cli.testing.execution import Manner, try_file
from taskspec_runner.cli.testing.last import LastOutcomes
from taskspec_runner.cli.testing.outcome import FileOutcome
from taskspec_runner.cli.testing.selection import chosen_by
from taskspec_runner.errors import InputError
from taskspec_runner.exit_codes import INTERNAL, MISSED, WELL, WRONG
from taskspec_runner.loop.interrupt import Termination
from taskspec_runner.record.folder import check_target
from taskspec_runner.record.whole import write_whole


def run_tests(
    paths: Sequence[Path],
    selection: ChoiceOptions,
    telling: ReportOptions,
    given: SeededOptions,
) -> int:
    """Runs task files and says what came of each.

    Args:
        paths: files, and folders of them.
        selection: which of them, and by how many processes.
        telling: how that is reported, and what is kept.
        given: what every file is changed by, and the seed of every run.

    Returns:
        0 if all passed; 3 after an internal error, 2 if a file could not be read, else 1.

    Raises:
        InputError: no file is chosen, or an option is none.
        OutputError: a file cannot be written.
    """
    if STDIN in paths:
        raise InputError("'-' is no file to test; taskspec run - runs one task")
    changes(given.sets, given.law)
    if telling.junit is not None:
        check_target(telling.junit)
    last = LastOutcomes(telling.out)
    listed = task_files(paths)
    for folder in listed.unread:
        typer.echo(f"taskspec: cannot read {folder}; nothing in it was tested", err=True)
    files = _chosen(listed.files, selection, last)
    manner = Manner(
        _folders(files, telling.out), tuple(given.sets), given.law, given.seed, telling.keep
    )
    began, outcomes = time.perf_counter(), list[FileOutcome]()
    width = max(len(str(path)) for path in files)
    work = functools.partial(try_file, manner=manner)
    processes = min(selection.jobs or processors(), len(files))
    try:
        with Termination(), closing(in_order(work, files, processes)) as found:
            for outcome in found:
                outcomes.append(outcome)
                if telling.form is OutcomeFormat.TEXT and not (telling.quiet and outcome.passed):
                    _tell(outcome, width)
                if selection.exit_first and not outcome.passed:
                    break
    finally:
        # What is known is kept, also of a campaign that is broken off.
        last.keep(outcomes)
    code = _code(outcomes)
    seconds = time.perf_counter() - began
    if telling.junit is not None:
        write_whole(telling.junit, junit.report(outcomes) + "\n")
    _sum_up(outcomes, len(files), telling, seconds, code)
    return code


def _chosen(files: list[Path], selection: ChoiceOptions, last: LastOutcomes) -> list[Path]:
    if selection.words is not None:
        is_chosen = chosen_by(selection.words)
        found = [path for path in files if is_chosen(path)]
        if not found:
            raise InputError(f"-k {selection.words!r} chooses none of {len(files)} task files")
        files = found
    if selection.last_failed:
        failed = last.failed(files)
        if not failed:
            typer.echo("none failed the last time: all are run", err=True)
        files = failed or files
    return last.failed_first(files) if selection.failed_first else files


def _folders(files: Sequence[Path], out: Path) -> dict[Path, Path]:
    """A folder for the run of each file: its name, with as many folders before it as it takes."""
    parts = {path: path.absolute().with_suffix("").parts[1:] for path in files}
    names = {path: parts[path][-1] for path in files}
    for count in range(2, max(map(len, parts.values()), default=0) + 1):
        taken = list(names.values())
        twice = [path for path in files if taken.count(names[path]) > 1]
        if not twice:
            break
        names |= {path: "-".join(parts[path][-count:]) for path in twice}
    # What is left differs in its suffix alone.
    taken = list(names.values())
    return {
        path: out / (name if taken.count(name) == 1 else f"{name}{path.suffix}")
        for path, name in names.items()
    }


def _tell(outcome: FileOutcome, width: int) -> None:
    from rich.text import Text

    mark = Text("passed", "green") if outcome.passed else Text("FAILED", "bold red")
    line = f"  {outcome.path:<{width}}  {outcome.seconds:6.2f} s  {outcome.counted}"
    show(Text.assemble(mark, line))


def _code(outcomes: Iterable[FileOutcome]) -> int:
    codes = {each.code for each in outcomes if not each.passed}
    if not codes:
        return WELL
    return next((code for code in (INTERNAL, WRONG) if code in codes), MISSED)


def _sum_up(
    outcomes: Sequence[FileOutcome], chosen: int, telling: ReportOptions, seconds: float, code: int
) -> None:
    failed = [each for each in outcomes if not each.passed]
    if telling.form is OutcomeFormat.JSON:
        files = [each.as_data() for each in outcomes]
        numbers = {"passed": len(outcomes) - len(failed), "failed": len(failed)}
        data = {"exit_code": code, **numbers, "seconds": seconds, "files": files}
        typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
    elif telling.form is OutcomeFormat.TEXT:
        _details(failed)
    else:
        reporter = junit if telling.form is OutcomeFormat.JUNIT else github
        if text := reporter.report(outcomes):
            typer.echo(text)
    for_programs = telling.form is not OutcomeFormat.TEXT
    if telling.durations:
        slowest = sorted(outcomes, key=lambda each: each.seconds, reverse=True)
        typer.echo("slowest:", err=for_programs)
        for each in slowest[: telling.durations]:
            typer.echo(f"  {each.seconds:6.2f} s  {each.path}", err=for_programs)
    words = [f"{len(failed)} failed"] if failed else []
    words.append(f"{len(outcomes) - len(failed)} passed")
    if chosen > len(outcomes):
        words.append(f"{chosen - len(outcomes)} not run")
    typer.echo(f"{', '.join(words)} in {seconds:.2f} s", err=for_programs)


def _details(failed: Sequence[FileOutcome]) -> None:
    from rich.text import Text

    for outcome in failed:
        show(Text(f"\n{outcome.path}", "bold"))
        if outcome.problem:
            typer.echo(outcome.problem)
            continue
        for case in outcome.failed:
            show(Text.assemble(("FAIL", "bold red"), f"  {case.title}"))
            if case.message:
                typer.echo(f"      {case.message}")
        if outcome.report:
            typer.echo(f"report: {outcome.report}")
    if failed:
        typer.echo("")
