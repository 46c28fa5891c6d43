"""Runs one task file as a test."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from taskspec.deferred_methods import dataclass
from taskspec.text.diagnostic import SpecError
from taskspec_runner.cli.guard import keep_trace
from taskspec_runner.cli.loading import load
from taskspec_runner.cli.testing.outcome import (
    FileOutcome,
    outcome_of,
    refused,
    refused_by,
)
from taskspec_runner.errors import InputError, OutputError, RunCrashedError
from taskspec_runner.exit_codes import INTERNAL, WRONG
from taskspec_runner.record.folder import clear


@dataclass(frozen=True)
class Manner:
    """Options with which files are run.

    Attributes:
        folders: of the run of each file.
        sets: overrides of every file, as `KEY=VALUE`.
        law: that replaces those of every file; None for their own.
        seed: of everything random.
        keeps: whether runs that passed are kept too, with their reports.
    """

    folders: Mapping[Path, Path]
    sets: Sequence[str] = ()
    law: str | None = None
    seed: int = 0
    keeps: bool = False


def try_file(path: Path, manner: Manner) -> FileOutcome:
    """Runs a task file and judges it; of what can go wrong with it, only the words.

    The folder of a run that passed is removed again, unless it is to be kept.
    """
    began = time.perf_counter()
    try:
        found = _tried(path, manner, began)
    except SpecError as error:
        found = refused_by(path, error)
    except (InputError, OutputError) as error:
        found = refused(path, str(error), WRONG)
    except RunCrashedError as error:
        text = f"internal error: {error}; what was logged is in {error.folder}"
        found = refused(path, f"{text}; please report this with {error.trace}", INTERNAL)
    except Exception as error:
        reason = f"internal error: {type(error).__name__}: {error}"
        found = refused(path, f"{reason}; please report this with {keep_trace(error)}", INTERNAL)
    return found


def _tried(path: Path, manner: Manner, began: float) -> FileOutcome:
    # Here, as a process that only hands files out need not load a simulator.
    from taskspec.compiler import compile_task
    from taskspec_runner.session import execute_program
    from taskspec_runner.sweep.chosen import chosen_world

    loaded = load(path, manner.sets, manner.law)
    try:
        program = compile_task(loaded)
    except SpecError as error:
        return refused_by(path, error, loaded.task.expect, loaded.task.name)
    world = chosen_world(program.context, manner.seed, None)
    run = execute_program(program, manner.folders[path], world=world, report=False)
    seconds = time.perf_counter() - began
    if run.exit_code == 0 and not manner.keeps:
        clear(run.folder)
        # What somebody else has put beside it stays.
        with contextlib.suppress(OSError):
            run.folder.rmdir()
        return outcome_of(run, path, seconds)
    from taskspec_runner.report import write_report

    write_report(run)
    return outcome_of(run, path, seconds, str(run.report))
