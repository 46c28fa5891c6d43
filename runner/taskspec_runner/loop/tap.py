"""What looks on while a run goes on, between the loop and its recorder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from taskspec_runner.loop.assembly import Assembly
from taskspec_runner.loop.driven import Driven
from taskspec_runner.record.block import Block
from taskspec_runner.record.recorder import Recorder


def _always() -> bool:
    return True


class Tap:
    """A recorder that also calls every so many ticks, the first one included.

    Attributes:
        block: of the recorder.
    """

    def __init__(
        self,
        recorder: Recorder | Tap,
        every: int,
        call: Callable[[], None],
        exact: Callable[[], bool] = _always,
    ) -> None:
        """Taps a recorder.

        Args:
            recorder: that every tick goes to.
            every: number of ticks between two calls.
            call: is called when the bus has the tick that is due.
            exact: whether blocks of ticks end at each that is due; otherwise the call comes after
                the block, which keeps blocks as long as they are without a tap.
        """
        self._recorder, self._every, self._call, self._exact = recorder, every, call, exact
        self.block: Block | None = recorder.block
        self._ticks, self._next = 0, 1

    def add(self) -> None:
        """Records the bus as it is now, and calls if it is due."""
        self._recorder.add()
        self._note(1)

    @property
    def left(self) -> int:
        """Ticks up to the next that is due, no more than the recorder takes at once."""
        left = self._recorder.left
        return min(left, max(self._next - self._ticks, 1)) if self._exact() else left

    def advance(self, ticks: int) -> None:
        """Takes note of ticks that are in the block, and calls if one was due."""
        self._recorder.advance(ticks)
        self._note(ticks)

    def by_machine_code(self) -> None:
        """Informs the recorder that machine code runs the ticks."""
        self._recorder.by_machine_code()

    def _note(self, ticks: int) -> None:
        self._ticks += ticks
        if self._ticks >= self._next:
            self._next = self._ticks + self._every - (self._ticks - 1) % self._every
            self._call()


def ticks_between(rate: float, period: float) -> int:
    """Number of ticks between two calls.

    Args:
        rate: calls in a second of simulated time [Hz].
        period: of control [s].
    """
    return max(1, round(1 / (rate * period)))


class Spectator(Protocol):
    """What looks at a simulated run while it goes on.

    Attributes:
        rate: how often in simulated time [Hz].
    """

    rate: float

    @property
    def looks(self) -> bool:
        """Whether it is to be called at `rate`; otherwise after each block of ticks."""

    def begin(self, parts: Assembly[Driven], recorder: Recorder, folder: Path) -> None:
        """Takes the parts of a run that starts now, what has its newest ticks, and its folder."""

    def look(self) -> None:
        """Takes the ticks since the last time; it may hold the run back."""

    def finish(self) -> None:
        """Learns that no more ticks will come."""
