"""`taskspec validate`: what is wrong with task files, by their rules and by a trial of each."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from taskspec.deferred_methods import dataclass
from taskspec.text.diagnostic import Diagnostic, Note, SpecError
from taskspec.text.source import Source
from taskspec_runner.cli.codes import choice
from taskspec_runner.cli.formats import DiagnosticFormat
from taskspec_runner.cli.given import OPTIONS, changes
from taskspec_runner.cli.guard import keep_trace
from taskspec_runner.cli.kept import Before
from taskspec_runner.cli.options import ValidateOptions
from taskspec_runner.cli.parallel import in_order
from taskspec_runner.cli.reporters import REPORTERS
from taskspec_runner.cli.task_files import task_files
from taskspec_runner.cli.validation import Failure, Validation
from taskspec_runner.errors import InputError
from taskspec_runner.loop.interrupt import Termination

if TYPE_CHECKING:
    from taskspec.examined import Examination
    from taskspec.spec import LoadedTask

#: Without these a file is read, but nothing that needs a robot can be checked.
_NUMERICAL = ("mujoco", "pinocchio", "casadi", "numpy", "scipy")
#: Without this all but the trial can be done.
_SIMULATOR = "mujoco"


AS_WRITTEN = ValidateOptions()


def validate_paths(
    paths: Sequence[Path],
    form: DiagnosticFormat,
    how: ValidateOptions = AS_WRITTEN,
    *,
    strict: bool = False,
    select: Sequence[str] = (),
    ignore: Sequence[str] = (),
    keeps: bool = True,
    sarif: Path | None = None,
) -> int:
    """Validates files and folders and says what was found.

    Args:
        paths: files, and folders of them; `STDIN` by itself.
        form: how it is reported.
        strict: whether warnings count as errors.
        select: prefixes of the codes that count, all of them if there are none.
        ignore: prefixes of codes that do not count.
        how: they are examined.
        keeps: whether what was found before is taken where nothing has changed since.
        sarif: a file that is to have the findings as SARIF too.

    Raises:
        OutputError: that file cannot be written.
        InputError: no code begins with one of the prefixes, a folder has no task file, or an
            override is not one.
    """
    chosen = choice(select, ignore)
    changes(how.sets, how.law)
    if sarif is not None:
        from taskspec_runner.record.folder import check_target

        check_target(sarif)
    listed = task_files(paths)
    found = examine(listed.files, how, strict=strict, keeps=keeps).only(chosen)
    found = replace(found, unread=tuple(listed.unread))
    if sarif is not None:
        from taskspec_runner.record.whole import whole

        with whole(sarif) as partial:
            partial.write_text(f"{REPORTERS[DiagnosticFormat.SARIF].report(found)}\n", "utf-8")
    for folder in found.unread:
        typer.echo(f"taskspec: cannot read {folder}; nothing in it was validated", err=True)
    for failure in found.unreadable:
        typer.echo(f"taskspec: {failure.message}", err=True)
    for failure in found.broken:
        typer.echo(failure.message, err=True)
    if found.unchecked:
        typer.echo(f"taskspec: {found.unchecked}", err=True)
    reporter = REPORTERS[form]
    text = reporter.report(found)
    if text:
        typer.echo(text)
    for line in found.worlds:
        typer.echo(line, err=reporter.for_programs)
    typer.echo(found.headline, err=reporter.for_programs)
    return found.exit_code


def examine(
    files: Sequence[Path],
    how: ValidateOptions = AS_WRITTEN,
    *,
    strict: bool = False,
    keeps: bool = True,
) -> Validation:
    """Everything that is found about the files; many of them are shared out to the processors.

    Of those that are as they were the last time, what was found then, if `keeps` allows it.
    """
    # An override stands in no file, so that where there are several each finding names its own.
    several = len(files) > 1
    # What is found in a world, or in many, is not kept.
    keeps = keeps and how.world is None and not how.worlds
    outcome_of = functools.partial(_outcome, how=how, several=several, keeps=keeps)
    diagnostics: dict[str, tuple[Diagnostic, ...]] = {}
    sources: dict[str, dict[str, Source]] = {}
    unreadable: list[Failure] = []
    broken: list[Failure] = []
    worlds: list[str] = []
    unchecked = ""
    with Termination():
        before = [_before(path, how, several) if keeps else None for path in files]
        left = [path for path, found in zip(files, before, strict=True) if found is None]
        with closing(in_order(outcome_of, left)) as outcomes:
            now = [found or next(outcomes) for found in before]
        for path, outcome in zip(files, now, strict=True):
            name = str(path)
            if isinstance(outcome, _Unreadable):
                unreadable.append(Failure(name, outcome.message))
            elif isinstance(outcome, _Broken):
                broken.append(Failure(name, outcome.message))
            else:
                diagnostics[name], sources[name] = outcome.diagnostics, outcome.sources
                unchecked = unchecked or outcome.unchecked
                if outcome.world:
                    worlds.append(f"{name}: {outcome.world}" if several else outcome.world)
    return Validation(
        tuple(map(str, files)),
        diagnostics,
        sources,
        tuple(unreadable),
        tuple(broken),
        strict,
        unchecked,
        tuple(worlds),
    )


@dataclass(frozen=True)
class _Unreadable:
    message: str


@dataclass(frozen=True)
class _Broken:
    message: str


Named = TypeVar("Named", Diagnostic, Note)


@dataclass(frozen=True)
class _Found:
    """The findings about a file.

    `unchecked` says what could not be checked, and why, `world` what is otherwise in the world
    that was examined.
    """

    diagnostics: tuple[Diagnostic, ...]
    sources: dict[str, Source]
    unchecked: str = ""
    world: str = ""


def _before(path: Path, how: ValidateOptions, several: bool) -> _Found | None:
    """The cached findings of an unchanged file; None where it has changed."""
    kept = Before(path, how.sets, how.law, static=how.static).found()
    if kept is None:
        return None
    found = _Found(kept.findings, kept.sources)
    return _attributed(found, path) if several and (how.sets or how.law) else found


def _outcome(
    path: Path, *, how: ValidateOptions, several: bool, keeps: bool
) -> _Found | _Unreadable | _Broken:
    """The findings about a file; of a failure to examine it, only the message."""
    try:
        found = _examine(path, how, keeps=keeps)
        return _attributed(found, path) if several and (how.sets or how.law) else found
    except InputError as error:
        return _Unreadable(str(error))
    except Exception as error:
        # One file must not hide what is found about the others.
        trace = keep_trace(error)
        reason = f"internal error: {type(error).__name__}: {' '.join(str(error).split())}"
        return _Broken(f"{path}: {reason}; please report this with {trace}")


def _attributed(found: _Found, path: Path) -> _Found:
    """What is found, that about options under the name of the file with which they do not go."""
    names = {option: f"{path} {option}" for option in OPTIONS}

    def named(place: Named) -> Named:
        return replace(place, source=names.get(place.source, place.source))

    return _Found(
        tuple(replace(named(d), notes=tuple(map(named, d.notes))) for d in found.diagnostics),
        {names.get(name, name): source for name, source in found.sources.items()},
        found.unchecked,
        found.world,
    )


def _examine(path: Path, how: ValidateOptions, *, keeps: bool) -> _Found:
    from taskspec_runner.cli.loading import load

    before = Before(path, how.sets, how.law, static=how.static, keeps=keeps)
    try:
        loaded = load(path, how.sets, how.law)
    except SpecError as error:
        return _Found(error.diagnostics, dict(error.sources))
    sources = dict(loaded.sources)
    differs = ""
    try:
        # A file that cannot even be read needs no robot, and one that is known no simulator.
        if how.world is not None:
            loaded, differs = _in_world(path, loaded, how.world, how.seed)
        examined, lacking = _checked(loaded, how)
        if not lacking:
            before.keep(examined)
        return _Found(examined.findings, sources, lacking, differs)
    except SpecError as error:
        return _Found(error.diagnostics, sources)
    except ImportError as error:
        missing = (error.name or "").partition(".")[0]
        if missing not in _NUMERICAL:
            raise
        return _Found(loaded.warnings, sources, _without(missing, error))


def _checked(loaded: LoadedTask, how: ValidateOptions) -> tuple[Examination, str]:
    """An examined task, and why its trial was left out; empty where it was not."""
    from taskspec.examination import ExaminationBounds, examine

    if how.static:
        # Rules need no simulator where the robot is known.
        examined = examine(loaded, bounds=ExaminationBounds())
    else:
        try:
            from taskspec_runner.trial.check import check
        except ImportError as error:
            if (error.name or "").partition(".")[0] != _SIMULATOR:
                raise
            return examine(loaded, bounds=ExaminationBounds()), (
                f"{_SIMULATOR} cannot be imported ({error}), so nothing was tried: what a run "
                "comes to was not checked"
            )
        examined = check(loaded)
    return (_with_worlds(examined, how) if how.worlds else examined), ""


def _with_worlds(examined: Examination, how: ValidateOptions) -> Examination:
    """The same with what is found in random worlds; of a task that is refused there are none."""
    from taskspec.compiler import admit
    from taskspec.program.program import refusals
    from taskspec.text.diagnostic import Diagnostics
    from taskspec_runner.sweep.tried import bad_worlds

    if examined.plan is None or refusals(examined.findings):
        return examined
    found = Diagnostics(examined.loaded.source.name)
    found.extend(examined.findings)
    for finding in bad_worlds(admit(examined), how.worlds, how.seed):
        finding.report(examined.loaded, found)
    return replace(examined, findings=found.sorted())


def _in_world(path: Path, loaded: LoadedTask, named: str, seed: int) -> tuple[LoadedTask, str]:
    """The task as if a world were the true one, and what is otherwise there.

    Raises:
        InputError: there is no such world.
        SpecError: the robot cannot be loaded, or its start cannot be reached.
    """
    from taskspec.program.prepare import prepare
    from taskspec.program.worlds import as_file, deviations
    from taskspec_runner.sweep.chosen import chosen_world

    context = prepare(loaded)
    try:
        world = chosen_world(context, seed, named)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    parts = [
        f"{e.name} {e.written[1]} (nominal {e.written[0]})" for e in deviations(context, world)
    ]
    differs = f"in truth {', '.join(parts)}" if parts else "as the file says"
    return as_file(loaded, world), f"{world.label}: {differs}" if world.label else differs


def _without(missing: str, error: ImportError) -> str:
    """The checks that are left out where a library cannot be imported."""
    return (
        f"{missing} cannot be imported ({error}), so only text, names, units and modes were "
        "checked; robot, start, contacts, motions and stability were not"
    )
