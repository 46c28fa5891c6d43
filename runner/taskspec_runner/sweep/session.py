"""A sweep from a compiled task to its folder: run what is not there yet, judge, write."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec.spec import Task
from taskspec_runner.errors import InputError
from taskspec_runner.record.folder import check_unlocked
from taskspec_runner.record.manifest import inputs, task_bytes, versions
from taskspec_runner.record.names import TABLE
from taskspec_runner.record.whole import write_whole
from taskspec_runner.sweep import kept
from taskspec_runner.sweep.bundle import Bundle, keep_program
from taskspec_runner.sweep.engine import Processes, leave_if_imported, processes, rows
from taskspec_runner.sweep.executors import Workers
from taskspec_runner.sweep.folder import (
    FORMAT,
    PAGE,
    SweepFolder,
    WrittenSweep,
    open_sweep,
    read_written,
)
from taskspec_runner.sweep.result import SweepResult
from taskspec_runner.sweep.summary import summarise
from taskspec_runner.sweep.table import table_bytes
from taskspec_runner.sweep.world_run import Row, broken_row
from taskspec_runner.sweep.worlds import Worlds, identity

#: Times that processes may die before worlds are run one by one, to find the one that kills them.
_DEATHS = 2
_WHOLE = (1, 1)


@dataclass(frozen=True, slots=True)
class SweepGlimpse:
    """A sweep as it goes on.

    Attributes:
        done: worlds that are there.
        of: how many there are to be.
        good: that succeeded.
        rate: worlds in a second; 0 before the first.
        left: [s]; infinite before the first.
        folder: of the sweep, with its rows so far.
    """

    done: int
    of: int
    good: int
    rate: float
    left: float
    folder: SweepFolder


Watch = Callable[[SweepGlimpse], None]


def sweep(
    program: Program,
    worlds: Worlds,
    out: Path | None = None,
    *,
    workers: Workers | None = None,
    shard: tuple[int, int] = _WHOLE,
    keep: str = kept.WORST,
    watch: Watch | None = None,
) -> SweepResult:
    """Runs every world of a sweep that is not there yet, and judges all of them.

    Args:
        program: of the task.
        worlds: which.
        out: the folder, which is continued where it holds the same sweep; None for
            `runs/NAME-sweep`.
        workers: who runs them; None for this process.
        shard: which share of them, from 1, and of how many; shares are put together by `merged`.
        keep: which runs are kept, as `kept.chosen` has it; of a share none is.
        watch: called now and then.

    Raises:
        OutputError: the folder cannot be written, or holds something else.
        InputError: a worker has other versions installed, `keep` names no worlds, or processes
            cannot begin as the script that calls has no `if __name__ == "__main__":`.
        KeyboardInterrupt: interrupted; the same call continues.
    """
    kept.check(keep, worlds.count)
    leave_if_imported()
    workers = Workers(None, 1) if workers is None else workers
    bundle = Bundle.of(program)
    keep_program(bundle, program)
    loaded = program.context.loaded
    said = opening(program, bundle, worlds) | {"shard": list(shard)}
    name = loaded.task.name
    if shard != _WHOLE:
        name = f"{name}-{shard[0]}-of-{shard[1]}"
    with open_sweep(out, name, said) as folder:
        folder.begin(task_bytes(loaded))
        continued = len(folder.rows)
        with _interrupts_told(folder, len(worlds.shard(*shard))), Crew(workers) as crew:
            _run_missing(folder, bundle, worlds, worlds.shard(*shard), crew, watch)
        if shard != _WHOLE:
            ordered = tuple(folder.rows[index] for index in sorted(folder.rows))
            good = sum(row["success"] for row in ordered)
            summary = {"shard": list(shard), "done": len(ordered), "good": good, "exit_code": 0}
            folder.end(**summary)
            return SweepResult(loaded.task, folder.path, ordered, summary, continued, shard)
        ended = _ended(loaded.task, folder)
        chosen = kept.chosen(keep, ended.rows)
        kept.keep_runs(folder.path, bundle, worlds, chosen, workers.jobs)
        _write_page(ended, folder)
        return SweepResult(ended.task, ended.path, ended.rows, ended.summary, continued)


def merged(
    task: Task, parts: Iterable[Mapping[int, Row]], folder: SweepFolder, count: int
) -> SweepResult:
    """Puts the shares of a sweep together.

    Args:
        task: of it.
        parts: rows of its shares, by world.
        folder: for all of it.
        count: worlds that it has.

    Raises:
        InputError: worlds are missing.
        OutputError: the folder cannot be written.
    """
    for part in parts:
        for index, row in part.items():
            if index not in folder.rows:
                folder.add(row)
    missing = [index for index in range(count) if index not in folder.rows]
    if missing:
        some = ", ".join(map(str, missing[:5])) + (", ..." if len(missing) > 5 else "")
        raise InputError(
            f"{len(missing)} of {count} worlds are in none of the shares: {some}; run the shares "
            "that are missing, or were broken off, and merge again"
        )
    ended = _ended(task, folder)
    _write_page(ended, folder)
    return ended


def read_result(path: Path) -> tuple[SweepResult, WrittenSweep]:
    """A sweep that is over, from its folder: what its rows say, judged again.

    Raises:
        InputError: it is no folder of a sweep, it was altered, or worlds are missing.
        SpecError: this version does not take its task.
    """
    read = read_written(path)
    if tuple(read.said["shard"]) != _WHOLE:
        number, of = read.said["shard"]
        raise InputError(
            f"{path} holds share {number} of {of} of a sweep; taskspec sweep --merge puts shares "
            "together"
        )
    if len(read.rows) < read.count:
        why = f": {read.damage}" if read.damage else ""
        raise InputError(
            f"{path} has {len(read.rows)} of {read.count} worlds{why}; the command that it was "
            "made with goes on with those that are missing"
        )
    task, rows = read.task.task, tuple(read.rows[index] for index in sorted(read.rows))
    summary = summarise(task, rows, read.said["worlds"]["kind"])
    return SweepResult(task, path, rows, summary), read


def write_page(result: SweepResult, read: WrittenSweep) -> Path:
    """Writes the page of a sweep that was read.

    Raises:
        OutputError: it cannot be written, or another process writes into the folder.
    """
    from taskspec_runner.sweep.page import render

    check_unlocked(result.path)
    return write_whole(result.path / PAGE, render(result, read.said))


def opening(program: Program, bundle: Bundle, worlds: Worlds) -> dict[str, Any]:
    """What tells a sweep from others."""
    loaded = program.context.loaded
    return {
        "format": FORMAT,
        "task": loaded.task.name,
        "file": None if loaded.path is None else str(loaded.path),
        "overrides": dict(loaded.overrides),
        "force": bool(program.forced),
        "worlds": worlds.as_data(),
        "bundle": bundle.key,
        "inputs": inputs(program),
        "identity": identity(bundle.key, worlds),
        "versions": versions(),
    }


@contextmanager
def _interrupts_told(folder: SweepFolder, of: int) -> Iterator[None]:
    """Lets whoever breaks a sweep off know what is left of it."""
    try:
        yield
    except KeyboardInterrupt as error:
        why = str(error) or "interrupted"
        there = f"{len(folder.rows)} of {of} worlds are in {folder.path}"
        error.args = (f"{why}: {there}; the same command goes on from there",)
        raise


class Crew:
    """Who runs a sweep: the executor that is given, or processes of this machine, begun once.

    Attributes:
        jobs: how many worlds at once.
    """

    def __init__(self, workers: Workers) -> None:
        self.jobs = workers.jobs
        self._given = workers.executor
        self._own: ExitStack | None = None
        self._pool: Processes | None = None
        self._begun = False

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *error: object) -> None:
        if self._own is not None and self._pool is not None:
            self._begun |= self._pool.begun
            own, self._own, self._pool = self._own, None, None
            # What ends them learns whether anybody still waits for what is under way.
            own.__exit__(*error)  # type: ignore[arg-type]

    @property
    def there(self) -> Executor | None:
        """The executor as far as there is one; None for this process."""
        return self._pool if self._given is None else self._given

    def executor(self) -> Executor | None:
        """The executor; None for this process."""
        if self._given is None and self.jobs > 1 and self._own is None:
            self._own = ExitStack()
            self._pool = self._own.enter_context(processes(self.jobs))
        return self.there

    def renew(self) -> bool:
        """Lets processes go of which one has died; returns whether they were of this sweep."""
        self.__exit__(None, None, None)
        return self._given is None

    def check_begun(self) -> None:
        """Tells processes that died of their work from those that never came to it.

        Raises:
            InputError: none has come to it.
        """
        if not self._begun:
            raise InputError(
                "no process of this sweep could begin: each first imports the script that sweeps; "
                "put what that script does under 'if __name__ == \"__main__\":', or take one job"
            )


def _run_missing(
    folder: SweepFolder,
    bundle: Bundle,
    worlds: Worlds,
    wanted: Sequence[int],
    crew: Crew,
    watch: Watch | None,
) -> None:
    """Runs the worlds that are not there; one that kills its process is a broken row."""

    def missing() -> list[int]:
        return [index for index in wanted if index not in folder.rows]

    progress = _Progress(folder, len(wanted), watch)
    for _ in range(_DEATHS):
        executor = crew.executor() if len(missing()) > 1 else crew.there
        try:
            progress.run(executor, bundle, worlds, missing(), crew.jobs)
        except BrokenProcessPool:
            if not crew.renew():
                raise
            continue
        return
    crew.check_begun()
    for index in missing():
        try:
            with processes(1) as pool:
                progress.run(pool, bundle, worlds, [index], 1)
        except BrokenProcessPool:
            folder.add(broken_row(index, "the process that ran it died"))


class _Progress:
    """Keeps rows as they come, and tells how far a sweep is."""

    def __init__(self, folder: SweepFolder, of: int, watch: Watch | None) -> None:
        self._folder, self._of, self._watch = folder, of, watch
        self._began, self._before = time.monotonic(), len(folder.rows)
        self._good = sum(row["success"] for row in folder.rows.values())

    def run(
        self,
        executor: Executor | None,
        bundle: Bundle,
        worlds: Worlds,
        indices: Sequence[int],
        jobs: int,
    ) -> None:
        self._look()
        for row in rows(executor, bundle, worlds, indices, jobs):
            self._folder.add(row)
            self._good += row["success"]
            self._look()

    def _look(self) -> None:
        if self._watch is None:
            return
        done = len(self._folder.rows)
        rate = (done - self._before) / max(time.monotonic() - self._began, 1e-9)
        left = (self._of - done) / rate if rate else math.inf
        self._watch(SweepGlimpse(done, self._of, self._good, rate, left, self._folder))


def _ordered(folder: SweepFolder) -> tuple[Row, ...]:
    return tuple(folder.rows[index] for index in sorted(folder.rows))


def _ended(task: Task, folder: SweepFolder) -> SweepResult:
    ordered = _ordered(folder)
    kind = folder.said["worlds"]["kind"]
    summary = summarise(task, ordered, kind)
    folder.write(TABLE, table_bytes(folder.rows, {"taskspec": task.name}))
    folder.end(**summary)
    return SweepResult(task, folder.path, ordered, summary)


def _write_page(result: SweepResult, folder: SweepFolder) -> None:
    """Writes the page of a sweep, which links what is kept."""
    # Templates and scripts are read where there is something to write.
    from taskspec_runner.sweep.page import render

    folder.write(PAGE, render(result, folder.said))
