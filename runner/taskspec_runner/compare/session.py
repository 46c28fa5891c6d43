"""Runs a task under each law that can, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace

from taskspec.program.worlds import true_world
from taskspec_runner.compare.attempt import Attempt
from taskspec_runner.errors import RunCrashedError
from taskspec_runner.record.folder import RunFolder
from taskspec_runner.session import Progress, execute_program

#: Law, its number from 1, how many there are -> what shows its progress.
Watching = Callable[[str, int, int], AbstractContextManager[Progress | None]]


def run_attempts(
    attempts: Sequence[Attempt], folder: RunFolder, seed: int, watching: Watching
) -> list[Attempt]:
    """Runs every compiled attempt; after an interrupt, no further one.

    Args:
        attempts: one for each law.
        folder: of the comparison; each run goes into a folder of its own below it.
        seed: of everything random.
        watching: shows progress.

    Returns:
        The attempts with their runs. An internal error under one law is told by its attempt
        and keeps the others from nothing.

    Raises:
        OutputError: a folder cannot be written.
        KeyboardInterrupt: interrupted outside the simulation itself.
    """
    able = [each.law for each in attempts if each.program is not None]
    done: list[Attempt] = []
    interrupted = False
    for each in attempts:
        if each.program is not None and not interrupted:
            with watching(each.law, able.index(each.law) + 1, len(able)) as progress:
                each = _run(each, folder, seed, progress)
            interrupted = bool(each.broken_off)
        done.append(each)
    return done


def _run(each: Attempt, folder: RunFolder, seed: int, progress: Progress | None) -> Attempt:
    assert each.program is not None
    world = true_world(each.program.context, seed)
    try:
        run = execute_program(
            each.program, folder.path / each.folder, world=world, progress=progress
        )
    except RunCrashedError as error:
        return replace(
            each, crash=f"internal error: {error}; please report this with {error.trace}"
        )
    return replace(each, run=run)
