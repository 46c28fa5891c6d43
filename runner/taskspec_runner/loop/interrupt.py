"""Signals during a run: heard at once, heeded between two ticks, so that the log stays whole.

And those of processes that work for this one: they leave Ctrl-C to it, and end when it does.
"""

from __future__ import annotations

import os
import signal
import threading
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

#: What a shell adds to the number of the signal that ended a process.
BY_SIGNAL = 128
#: Signals that end a process; where a terminal can hang up, that too.
_TERMINATING = tuple(
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)
)
_ALL = {signal.SIGINT, *_TERMINATING}


class Terminated(KeyboardInterrupt):
    """A signal other than Ctrl-C has ended the process.

    Attributes:
        number: of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__(f"terminated by {signal.Signals(number).name}")
        self.number = number


def signal_of(error: KeyboardInterrupt) -> int:
    """Number of the signal that an interrupt stands for."""
    return error.number if isinstance(error, Terminated) else int(signal.SIGINT)


class _Handlers(ABC):
    """Signal handlers for a while; outside the main thread, where there are none, it does nothing.

    A signal that is ignored, as under `nohup`, stays ignored.
    """

    def __init__(self, numbers: tuple[int, ...]) -> None:
        self._numbers = numbers
        self._usual: dict[int, Any] = {}

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for number in self._numbers:
                usual = signal.getsignal(number)
                if usual not in (None, signal.SIG_IGN):
                    self._usual[number] = usual
                    signal.signal(number, self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    @abstractmethod
    def _hear(self, number: int, _frame: FrameType | None) -> None:
        """Takes a signal."""

    def _restore(self) -> None:
        while self._usual:
            signal.signal(*self._usual.popitem())


class Termination(_Handlers):
    """Makes SIGTERM and SIGHUP an exception, as SIGINT is, so that a run is closed properly."""

    def __init__(self) -> None:
        super().__init__(_TERMINATING)

    def _hear(self, number: int, _frame: FrameType | None) -> None:
        raise Terminated(number)


class Interrupt(_Handlers):
    """Keeps the first SIGINT, SIGTERM or SIGHUP until `check`; the second acts as usual."""

    def __init__(self) -> None:
        super().__init__((signal.SIGINT, *_TERMINATING))
        self._pending = 0

    def check(self) -> None:
        """Heeds a signal.

        Raises:
            KeyboardInterrupt: there was one; `Terminated` unless it was SIGINT.
        """
        pending, self._pending = self._pending, 0
        if pending == signal.SIGINT:
            raise KeyboardInterrupt
        if pending:
            raise Terminated(pending)

    def _hear(self, number: int, _frame: FrameType | None) -> None:
        self._pending = number
        self._restore()


@contextmanager
def deaf() -> Iterator[None]:
    """Keeps signals for later, so that processes are begun whole, and deaf too until they begin."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _ALL)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def begin_worker() -> None:
    """What a process that works for another one does first; it ends with that one."""
    # Ctrl-C reaches every process of a terminal; the first one ends the others.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _ALL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    import multiprocessing

    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
