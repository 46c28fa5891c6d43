"""Who sets live params while a run goes on."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from taskspec.program.execution.live_params import LiveParams


class Hand(Protocol):
    """What sets live params between the ticks of a run."""

    def set(self, live: LiveParams, ticks: int) -> int | None:
        """Sets what is due before a tick.

        Args:
            live: the params of the run.
            ticks: that have been run.

        Returns:
            After how many ticks, at least one, it is to be called again; None for never.
        """

    @property
    def lines(self) -> tuple[str, ...]:
        """What it has set so far, as `--live` takes it: a run with these is the same one."""


class Hands:
    """Several hands: of two that set a param before one tick the later one counts."""

    def __init__(self, hands: Sequence[Hand]) -> None:
        self._hands = tuple(hands)

    def set(self, live: LiveParams, ticks: int) -> int | None:
        """Has each set what is due; see `Hand`."""
        found = [hand.set(live, ticks) for hand in self._hands]
        return min((after for after in found if after is not None), default=None)

    @property
    def lines(self) -> tuple[str, ...]:
        """What they have set, hand after hand."""
        return tuple(line for hand in self._hands for line in hand.lines)
