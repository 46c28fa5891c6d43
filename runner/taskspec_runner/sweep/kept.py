"""Runs of a sweep that are kept: chosen worlds once more, with log and report."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from pathlib import Path

from taskspec_runner.errors import InputError
from taskspec_runner.record.extent import ENDED
from taskspec_runner.record.folder import read_json
from taskspec_runner.record.names import MANIFEST
from taskspec_runner.sweep.bundle import Bundle, program_of
from taskspec_runner.sweep.engine import processes
from taskspec_runner.sweep.folder import KEPT
from taskspec_runner.sweep.summary import worst_worlds
from taskspec_runner.sweep.world_run import BROKEN, Row
from taskspec_runner.sweep.worlds import Worlds

NONE, WORST, FAILED, ALL = "none", "worst", "failed", "all"


def chosen(keep: str, rows: Sequence[Row]) -> list[int]:
    """The worlds whose runs are to be kept.

    Args:
        keep: `none`, `worst`, `failed`, `all`, or numbers of worlds with commas between them.
        rows: of the sweep.
    """
    ran = [int(row["world"]) for row in rows if row["status"] != BROKEN]
    if keep == NONE:
        return []
    if keep == ALL:
        return ran
    if keep == FAILED:
        return [int(row["world"]) for row in rows if not row["success"] and row["status"] != BROKEN]
    if keep == WORST:
        return sorted(int(row["world"]) for row in worst_worlds(rows).values())
    # Of a world that broke there is no run.
    return sorted(set(_numbers(keep)).intersection(ran))


def check(keep: str, count: int | None = None) -> None:
    """Finds out whether a text names worlds to keep, before any has been run.

    Args:
        keep: as in `chosen`.
        count: how many worlds there are; None where that is not known yet.

    Raises:
        InputError: it does not.
    """
    if keep in (NONE, WORST, FAILED, ALL):
        return
    if not all(part.strip().isdecimal() for part in keep.split(",")):
        known = f"{NONE}, {WORST}, {FAILED}, {ALL}"
        raise InputError(f"--keep takes {known} or numbers such as 3,17, not {keep!r}")
    if count is not None and (most := max(_numbers(keep))) >= count:
        raise InputError(f"--keep names world {most}; this sweep has those from 0 to {count - 1}")


def _numbers(keep: str) -> list[int]:
    return [int(part) for part in keep.split(",")]


def folder_of(path: Path, world: int) -> Path:
    """Where the run of a world is kept, in the folder of a sweep."""
    return path / KEPT / f"{world:06}"


def keep_runs(
    path: Path,
    bundle: Bundle,
    worlds: Worlds,
    indices: Sequence[int],
    jobs: int,
    watch: Callable[[int, int], None] | None = None,
) -> None:
    """Runs worlds again on this machine, each into the folder of a run.

    Args:
        path: folder of the sweep.
        bundle: the task and what it reads.
        worlds: which worlds the sweep has.
        indices: of those that are kept; one that is there already is left alone.
        jobs: how many at once.
        watch: called with how many are done, and of how many.
    """
    missing = [i for i in indices if read_json(folder_of(path, i) / MANIFEST).get("status")
               not in ENDED]  # fmt: skip
    if jobs <= 1 or len(missing) < 2:
        for done, index in enumerate(missing, 1):
            keep_run(path, bundle, worlds, index)
            if watch is not None:
                watch(done, len(missing))
        return
    with processes(jobs) as pool:
        futures = [pool.submit(keep_run, path, bundle, worlds, index) for index in missing]
        for done, future in enumerate(as_completed(futures), 1):
            future.result()
            if watch is not None:
                watch(done, len(missing))


def keep_run(path: Path, bundle: Bundle, worlds: Worlds, index: int) -> None:
    """Runs a world with log and report."""
    from taskspec_runner.session import execute_program

    program = program_of(bundle, examined=True)
    folder = folder_of(path, index)
    folder.parent.mkdir(exist_ok=True)
    execute_program(program, folder, world=worlds.world(program.context, index))
