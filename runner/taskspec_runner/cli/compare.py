"""`taskspec compare`: a task under several laws, from its file to one table and one picture."""

from __future__ import annotations

import functools
import json
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import typer

from taskspec.laws import LAWS
from taskspec.spec import Law, LoadedTask
from taskspec.spec.words import Word
from taskspec.text.diagnostic import Diagnostic, SpecError
from taskspec.text.render import headline, plain
from taskspec.text.suggest import suggestion
from taskspec_runner.cli.diagnostics import record, show_diagnostics
from taskspec_runner.cli.formats import Equal, RunFormat
from taskspec_runner.cli.loading import load
from taskspec_runner.cli.options import CompareOptions
from taskspec_runner.cli.progress import progress_line
from taskspec_runner.compare.attempt import AS_WRITTEN, Attempt, attempt
from taskspec_runner.compare.comparison import comparison
from taskspec_runner.compare.folder import (
    PAGE,
    PICTURE,
    check_comparison,
    open_comparison,
)
from taskspec_runner.compare.gains import equal_bandwidth
from taskspec_runner.compare.page import write_comparison
from taskspec_runner.compare.session import run_attempts
from taskspec_runner.compare.summary import opening, summarise
from taskspec_runner.errors import InputError
from taskspec_runner.exit_codes import WRONG
from taskspec_runner.loop.interrupt import Termination
from taskspec_runner.record import folder as folders
from taskspec_runner.record.folder import RunFolder, check_unlocked
from taskspec_runner.record.names import COMPARISON
from taskspec_runner.session import Progress


def compare_laws(file: Path, given: CompareOptions) -> int:
    """Runs a task file under several laws and compares them."""
    from taskspec_runner.cli.comparison import show_comparison

    sets, out, quiet = given.sets, given.out, given.quiet
    names = [AS_WRITTEN, *chosen(given.law)]
    if out is not None:
        # Before anything is compiled.
        check_unlocked(out)
        check_comparison(out)
    attempts = [attempt(law, functools.partial(_loaded, file, sets, given.equal)) for law in names]
    if given.law is None:
        # Of all laws those that command what the robot takes.
        attempts = [a for a in attempts if a.law == AS_WRITTEN or not _unfit(a)]
    as_data = given.form is RunFormat.JSON
    if everywhere := _everywhere(attempts):
        # The file is wrong whatever the law, so there is nothing to say of the laws.
        if not as_data:
            raise SpecError(everywhere, attempts[0].sources)
        _print({"exit_code": WRONG, "diagnostics": [record(d) for d in everywhere]})
        return WRONG
    loaded = next((a.program.context.loaded for a in attempts if a.program), None)
    name = loaded.task.name if loaded else file.stem
    opened = opening(name, str(file), sets, given.seed, _notes(file, sets, loaded))
    opened["equal"] = given.equal
    folder = None
    if loaded is not None:
        if not quiet:
            _show_warnings(attempts)
        folder = open_comparison(out, name)
        attempts = _run(attempts, folder, opened, shown=not quiet and sys.stderr.isatty())
    summary = summarise(attempts, opened)
    if as_data:
        _print({**summary, **_whereabouts(folder), "laws": _with_findings(summary, attempts)})
    else:
        show_comparison(summary, quiet=quiet)
        if folder is not None and not quiet:
            # By itself in its line, so that a terminal makes a link of it.
            typer.echo(f"page: {folder.path / PAGE}")
    return int(summary["exit_code"])


def chosen(laws: Sequence[str] | None) -> list[str]:
    """The laws to compare, each once; all that are supported where none is named.

    Raises:
        InputError: the language has no such law.
    """
    if laws is None:
        return list(LAWS)
    reserved = next(
        w.reserved for w in Law.model_fields["kind"].metadata if isinstance(w, Word)
    )  # fmt: skip
    for law in laws:
        if law not in LAWS and law not in reserved:
            near = suggestion(law, LAWS)
            said = f"there is no law {law!r}" if law.strip() else "--law needs the name of a law"
            hint = f"{near} " if near else ""
            raise InputError(f"{said}; {hint}the laws are {', '.join(LAWS)}")
    return list(dict.fromkeys(laws))


def _loaded(file: Path, sets: Sequence[str], equal: Equal | None, law: str) -> LoadedTask:
    if law == AS_WRITTEN:
        return load(file, sets)
    return load(file, sets, law, equal_bandwidth(law) if equal is Equal.BANDWIDTH else None)


def _unfit(attempt: Attempt) -> bool:
    """Whether a law commands what the robot does not take."""
    return any(d.code == "TS140" for d in attempt.errors)


def _everywhere(attempts: Sequence[Attempt]) -> list[Diagnostic]:
    """The errors that keep every law from running."""
    first, *others = attempts
    return [d for d in first.errors if all(d in each.errors for each in others)]


def _run(
    attempts: Sequence[Attempt], folder: RunFolder, opened: dict[str, Any], *, shown: bool
) -> list[Attempt]:
    def watching(law: str, number: int, total: int) -> AbstractContextManager[Progress | None]:
        return progress_line(shown=shown, before=f"{law} ({number} of {total})  ")

    # Written at once, so that a folder that was left half done is known for what it is.
    folder.write_sealed(COMPARISON, opened)
    with folder, Termination():
        done = run_attempts(attempts, folder, opened["seed"], watching)
        summary = summarise(done, opened)
        folder.write_sealed(COMPARISON, summary)
        runs = {each.law: each.run for each in done if each.run}
        write_comparison(comparison(folders.plain(summary), runs), folder.path)
    return done


def _notes(file: Path, sets: Sequence[str], loaded: LoadedTask | None) -> list[str]:
    """What a reader must know of the laws that are compared and the file's own."""
    notes = []
    try:
        own = load(file, sets).task.law
    except SpecError:
        own = None
    gains = {gain.partition(".")[0] for facts in LAWS.values() for gain in facts.gain_names}
    if own is not None and own.model_dump(include={*gains, "joint_damping"}, exclude_none=True):
        notes.append(
            f"every law has designed gains; those that the file gives {own.kind} are in the row "
            f"'{AS_WRITTEN}' alone"
        )
    stages = [n for n, s in loaded.task.stages.items() if s.law is not None] if loaded else []
    if stages:
        several = len(stages) > 1
        which = f"{'s' if several else ''} {', '.join(stages)}"
        verb = "have laws of their own, which are" if several else "has a law of its own, which is"
        notes.append(f"stage{which} {verb} replaced too, but not '{AS_WRITTEN}'")
    return notes


def _show_warnings(attempts: Sequence[Attempt]) -> None:
    """Findings that all laws have in common, then those of a law alone with its name."""
    able = [each for each in attempts if each.program]
    common = [d for d in able[0].diagnostics if all(d in each.diagnostics for each in able)]
    show_diagnostics(common, able[0].sources, concise=True, err=True)
    for each in able:
        for finding in each.diagnostics:
            if finding not in common:
                typer.echo(f"{each.law}: {plain([headline(finding)])}", err=True)


def _whereabouts(folder: RunFolder | None) -> dict[str, str | None]:
    paths = {"page": PAGE, "picture": PICTURE}
    found = {key: str(folder.path / name) if folder else None for key, name in paths.items()}
    return {"folder": str(folder.path) if folder else None, **found}


def _with_findings(summary: dict[str, Any], attempts: Sequence[Attempt]) -> list[dict[str, Any]]:
    return [
        {**law, "diagnostics": [record(d) for d in each.diagnostics]}
        for law, each in zip(summary["laws"], attempts, strict=True)
    ]


def _print(data: dict[str, Any]) -> None:
    typer.echo(json.dumps(data, indent=2, ensure_ascii=False))
