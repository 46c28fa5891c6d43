"""Signals during a run: heard at once, heeded between two ticks, so that the log stays whole."""

from __future__ import annotations

import signal
import threading
from abc import ABC, abstractmethod
from types import FrameType
from typing import Any, Self

#: What a shell adds to the number of the signal that ended a process.
BY_SIGNAL = 128
#: What asks a process to end; where a terminal can hang up, that too.
_TERMINATING = tuple(
    getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class Terminated(KeyboardInterrupt):
    """A signal other than Ctrl-C has asked the process to end.

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
