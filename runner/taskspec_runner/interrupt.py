"""Ctrl-C during a run: heard at once, heeded between two ticks, so that the log stays whole."""

from __future__ import annotations

import signal
import threading
from types import FrameType
from typing import Self


class Interrupt:
    """Keeps the first SIGINT until `check`; the second one interrupts as usual.

    Outside the main thread signals cannot be caught: there it does nothing.
    """

    def __init__(self) -> None:
        self._asked = False
        self._usual: signal.Handlers | object = None

    def __enter__(self) -> Self:
        usual = signal.getsignal(signal.SIGINT)
        main = threading.current_thread() is threading.main_thread()
        if main and usual not in (None, signal.SIG_IGN):
            self._usual = usual
            signal.signal(signal.SIGINT, self._hear)
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    def check(self) -> None:
        """Heeds an interrupt.

        Raises:
            KeyboardInterrupt: there was one.
        """
        if self._asked:
            self._asked = False
            raise KeyboardInterrupt

    def _hear(self, _number: int, _frame: FrameType | None) -> None:
        self._asked = True
        self._restore()

    def _restore(self) -> None:
        if self._usual is not None:
            signal.signal(signal.SIGINT, self._usual)  # type: ignore[arg-type]
            self._usual = None
