"""A sweep from a compiled task to its folder: run what is not there yet, judge, write."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec_runner.record.folder import Json
from taskspec_runner.record.manifest import task_bytes, versions
from taskspec_runner.sweep.bundle import Bundle, keep_program
from taskspec_runner.sweep.engine import processes, rows
from taskspec_runner.sweep.folder import FORMAT, TABLE, SweepFolder, open_sweep
from taskspec_runner.sweep.summary import summarise
from taskspec_runner.sweep.table import table_bytes
from taskspec_runner.sweep.world_run import Row
from taskspec_runner.sweep.worlds import Worlds, identity


@dataclass(frozen=True, slots=True)
class SweepGlimpse:
    """A sweep as it goes on.

    Attributes:
        done: worlds that are there.
        of: how many there are to be.
        good: that succeeded.
        rate: worlds in a second; 0 where that is not known yet.
        left: [s]; None where that is not known yet.
    """

    done: int
    of: int
    good: int
    rate: float
    left: float | None


Watch = Callable[[SweepGlimpse], None]


@dataclass(frozen=True, slots=True)
class SweepResult:
    """A sweep that is over.

    Attributes:
        program: of its task.
        path: of its folder.
        rows: in the order of the worlds.
        summary: what `sweep.json` says.
        continued: worlds that were there before.
    """

    program: Program
    path: Path
    rows: tuple[Row, ...]
    summary: Json
    continued: int


def sweep(
    program: Program,
    worlds: Worlds,
    out: Path | None = None,
    *,
    executor: Executor | None = None,
    jobs: int = 1,
    watch: Watch | None = None,
) -> SweepResult:
    """Runs every world of a sweep that is not there yet, and judges all of them.

    Args:
        program: of the task.
        worlds: which.
        out: the folder, which is continued where it holds the same sweep; None for
            `runs/NAME-sweep`.
        executor: any of `concurrent.futures`' kind; None for processes of this machine, or with one
            job for this one.
        jobs: how many workers there are.
        watch: called now and then.

    Raises:
        OutputError: the folder cannot be written, or holds something else.
        InputError: a worker has other versions installed.
        KeyboardInterrupt: interrupted; the same call continues.
    """
    bundle = Bundle.of(program)
    keep_program(bundle, program)
    said = opening(program, bundle, worlds)
    loaded = program.context.loaded
    with open_sweep(out, loaded.task.name, said) as folder:
        folder.begin(task_bytes(loaded))
        continued = len(folder.rows)
        missing = [index for index in range(worlds.count) if index not in folder.rows]
        if executor is None and jobs > 1 and len(missing) > 1:
            with processes(jobs) as pool:
                _run(folder, bundle, worlds, missing, pool, jobs, watch)
        else:
            _run(folder, bundle, worlds, missing, executor, jobs, watch)
        return _ended(program, folder, continued)


def opening(program: Program, bundle: Bundle, worlds: Worlds) -> dict[str, Any]:
    """What tells a sweep from others."""
    loaded = program.context.loaded
    return {
        "format": FORMAT,
        "task": loaded.task.name,
        "file": None if loaded.path is None else str(loaded.path),
        "overrides": dict(loaded.overrides),
        "worlds": worlds.as_data(),
        "bundle": bundle.key,
        "identity": identity(bundle.key, worlds),
        "versions": versions(),
    }


def _run(
    folder: SweepFolder,
    bundle: Bundle,
    worlds: Worlds,
    missing: list[int],
    executor: Executor | None,
    jobs: int,
    watch: Watch | None,
) -> None:
    began, before = time.monotonic(), len(folder.rows)
    good = sum(row["success"] for row in folder.rows.values())
    for row in rows(executor, bundle, worlds, missing, jobs):
        folder.add(row)
        good += row["success"]
        if watch is not None:
            here = len(folder.rows) - before
            rate = here / max(time.monotonic() - began, 1e-9)
            left = (len(missing) - here) / rate
            watch(SweepGlimpse(len(folder.rows), worlds.count, good, rate, left))


def _ended(program: Program, folder: SweepFolder, continued: int) -> SweepResult:
    ordered = tuple(folder.rows[index] for index in sorted(folder.rows))
    summary: Mapping[str, Any] = summarise(program.context.loaded.task, ordered)
    folder.write(TABLE, table_bytes(folder.rows, {"taskspec": program.context.loaded.task.name}))
    folder.end(**summary)
    return SweepResult(program, folder.path, ordered, summary, continued)
