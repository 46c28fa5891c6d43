"""Messages to everybody who has a page open; who sends never waits for who reads."""

from __future__ import annotations

import json
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import field
from typing import Any

from taskspec.deferred_methods import dataclass


@dataclass(frozen=True, slots=True)
class Message:
    """A message.

    Attributes:
        number: 1 for the first of a channel.
        kind: one word, the name of its event in a page.
        text: JSON.
    """

    number: int
    kind: str
    text: str


@dataclass(slots=True)
class Channel:
    """Keeps messages for those who read them, as many as a newcomer is to have.

    Of a kind that passes, such as rows of a run, the last `keep` are kept: a reader that is too
    slow misses the ones before. Of every other kind only the last counts, and it is kept.

    Attributes:
        keep: messages that pass.
    """

    keep: int
    _passing: deque[Message] = field(init=False)
    _lasting: dict[str, Message] = field(default_factory=dict)
    _changed: threading.Condition = field(default_factory=threading.Condition)
    _number: int = 0
    _readers: int = 0
    _closed: bool = False

    def __post_init__(self) -> None:
        self._passing = deque(maxlen=self.keep)

    def send(self, kind: str, data: Any, *, passes: bool = False) -> None:
        """Leaves a message, whose data have no numbers that are not finite."""
        text = json.dumps(data, separators=(",", ":"), allow_nan=False)
        with self._changed:
            self._number += 1
            message = Message(self._number, kind, text)
            if passes:
                self._passing.append(message)
            else:
                self._lasting[kind] = message
            self._changed.notify_all()

    def after(self, number: int, patience: float) -> list[Message]:
        """The messages after one of a number, in order; waits for the first [s]."""

        def found() -> list[Message]:
            kept = (*self._passing, *self._lasting.values())
            return sorted((m for m in kept if m.number > number), key=lambda m: m.number)

        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._number > number, patience)
            return found()

    @contextmanager
    def reader(self) -> Iterator[None]:
        """Is counted as a reader meanwhile."""
        with self._changed:
            self._readers += 1
        try:
            yield
        finally:
            with self._changed:
                self._readers -= 1
                self._changed.notify_all()

    @property
    def read(self) -> bool:
        """Whether anybody reads."""
        return self._readers > 0

    @property
    def closed(self) -> bool:
        """Whether no more messages will come."""
        return self._closed

    def close(self, patience: float = 0.0) -> None:
        """Has readers go when they have read what there is; waits for them [s]."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: not self._readers, patience)
