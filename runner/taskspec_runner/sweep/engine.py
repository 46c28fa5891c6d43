"""The runner of worlds: work for any executor, and the rows that come back."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from itertools import islice
from typing import TYPE_CHECKING, TypeVar

from taskspec.deferred_methods import dataclass
from taskspec_runner.loop.fixed_step import NATIVE, PYTHON, loop_wanted
from taskspec_runner.loop.interrupt import begin_worker, deaf
from taskspec_runner.sweep.bundle import Bundle, program_of
from taskspec_runner.sweep.world_run import Row, run_world
from taskspec_runner.sweep.worlds import Worlds

if TYPE_CHECKING:
    from multiprocessing.synchronize import Event

T = TypeVar("T")

#: Worlds that a worker is given at once, at most.
_AT_ONCE = 16
#: Pieces of work that wait for each worker, beside the one under way.
_WAITING = 2


@dataclass(frozen=True, slots=True)
class Work:
    """Some worlds of a sweep: all that a worker needs to run them, wherever it is.

    Attributes:
        bundle: the task and what it reads.
        worlds: which worlds the sweep has.
        indices: of those that are to be run.
    """

    bundle: Bundle
    worlds: Worlds
    indices: tuple[int, ...]


def run_work(work: Work) -> list[Row]:
    """Runs some worlds, one after the other; what a worker does.

    Raises:
        InputError: other versions are installed here.
        SpecError: the task does not compile here.
    """
    program = program_of(work.bundle)
    context = program.context
    return [
        run_world(program, index, work.worlds.world(context, index), fastest_loop())
        for index in work.indices
    ]


def fastest_loop() -> str:
    """Machine code from the first tick on, where there is some: it serves all worlds."""
    from taskspec.native.engine import missing

    return loop_wanted(None) or (PYTHON if missing() else NATIVE)


def rows(
    executor: Executor | None, bundle: Bundle, worlds: Worlds, indices: Sequence[int], jobs: int
) -> Iterator[Row]:
    """The rows of worlds, in the order in which they are ready.

    Args:
        executor: any of `concurrent.futures`' kind; None to run them here, one after the other.
        bundle: the task and what it reads.
        worlds: which worlds the sweep has.
        indices: of those that are to be run.
        jobs: how many workers the executor has.
    """
    at_once = 1 if executor is None else max(1, min(_AT_ONCE, len(indices) // (4 * jobs)))
    pieces = [
        Work(bundle, worlds, tuple(indices[first : first + at_once]))
        for first in range(0, len(indices), at_once)
    ]
    for found in results(executor, run_work, pieces, jobs):
        yield from found


def results(
    executor: Executor | None, function: Callable[[Work], T], pieces: Sequence[Work], jobs: int
) -> Iterator[T]:
    """What a function makes of pieces of work, in the order in which it is ready.

    Only a few pieces are handed out at a time, so that little is lost where somebody stops.
    """
    if executor is None:
        yield from map(function, pieces)
        return
    left = iter(pieces)
    waiting: set[Future[T]] = set()
    while True:
        room = jobs * (1 + _WAITING) - len(waiting)
        waiting |= {executor.submit(function, piece) for piece in islice(left, room)}
        if not waiting:
            return
        done, waiting = wait(waiting, return_when=FIRST_COMPLETED)
        for each in done:
            yield each.result()


class Processes(ProcessPoolExecutor):
    """Processes of this machine; `begun` tells whether any has come so far as to take work."""

    def __init__(self, jobs: int) -> None:
        # A process that was forked would share threads and locks with this one.
        context = multiprocessing.get_context("spawn")
        self._begun = context.Event()
        super().__init__(jobs, context, initializer=_begin, initargs=(self._begun,))

    @property
    def begun(self) -> bool:
        """Whether any process has begun."""
        return self._begun.is_set()


def _begin(begun: Event) -> None:
    begin_worker()
    begun.set()


def leave_if_imported() -> None:
    """Ends a process that helps a sweep and runs the sweep's own script as it imports it.

    Python would end it anyway, with a trace; the sweep that began it says what is wrong.
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        raise SystemExit(1)


@contextmanager
def processes(jobs: int) -> Iterator[Processes]:
    """Processes of this machine, which end with this one."""
    before = set(multiprocessing.active_children())
    pool = Processes(jobs)
    try:
        with deaf():
            for _ in range(jobs):
                pool.submit(_nothing)
        yield pool
    except BaseException:
        # What is under way is run again by whoever continues; nobody waits for it here.
        for process in {*multiprocessing.active_children()} - before:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _nothing() -> None:
    """What a process is begun with."""
