"""Who sets live params while a run goes on."""

from __future__ import annotations

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
