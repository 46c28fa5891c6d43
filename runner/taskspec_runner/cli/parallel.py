"""Many files at once: `validate` spreads them over the processors, in the order of the files.

Processes are imported where there are many: for one file that takes as long as reading it.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from taskspec_runner.loop.interrupt import begin_worker, deaf

if TYPE_CHECKING:
    from multiprocessing.synchronize import Event

T = TypeVar("T")

#: Fewer files than these are done before further processes have loaded their libraries.
FEWEST = 100
_AT_ONCE = 8
#: Of a process of the pool: set once nobody waits for its results any more.
_over: Event | None = None


def collect_rarely() -> None:
    """Has Python look for cycles of garbage more rarely than it does by itself.

    Modules and models are some hundred thousand objects that stay. To look through them as often
    as for a small program is a tenth of the time of validating.
    """
    gc.set_threshold(200_000, 20, 20)


def in_order(
    work: Callable[[Path], T], files: Sequence[Path], processes: int | None = None
) -> Generator[T, None, None]:
    """The results of `work` for each file, in the order of the files.

    Where processes cannot be had, or one is lost, the files that are left are done here.

    Args:
        work: a function of a module, which lets no exception out.
        files: what it is called with.
        processes: to which they are shared out, one by one. None for files that take little: from
            `FEWEST` on, some at a time to one process for each processor.
    """
    at_once = 1
    if processes is None:
        at_once = _AT_ONCE
        processes = min(processors(), len(files) // (FEWEST // 2)) if len(files) >= FEWEST else 1
    done = 0
    if min(processes, len(files)) > 1:
        from concurrent.futures.process import BrokenProcessPool

        try:
            for result in _shared(work, files, min(processes, len(files)), at_once):
                done += 1
                yield result
        except (BrokenProcessPool, OSError):
            pass
    for path in files[done:]:
        yield work(path)


def _shared(
    work: Callable[[Path], T], files: Sequence[Path], processes: int, at_once: int
) -> Iterator[T]:
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    context = multiprocessing.get_context("spawn")
    over = context.Event()
    pool = ProcessPoolExecutor(processes, context, initializer=_begin, initargs=(over,))
    try:
        with deaf():
            results = pool.map(partial(_unless_over, work), files, chunksize=at_once)
        yield from results
    finally:
        # Files that have been handed out are dropped too: an interruption waits for one at most.
        over.set()
        pool.shutdown(wait=True, cancel_futures=True)


def _unless_over(work: Callable[[Path], T], path: Path) -> T:
    if _over is not None and _over.is_set():
        from concurrent.futures import CancelledError

        raise CancelledError
    return work(path)


def _begin(over: Event) -> None:
    global _over
    _over = over
    collect_rarely()
    begin_worker()


def processors() -> int:
    """Number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
