"""The part of a run that its log holds, and whether the run came to its end."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.manifest import RUNNING

#: Statuses of a run whose log is complete.
ENDED = ("done", "failed", "stopped", "undecided")
_WHY = {
    RUNNING: "it was killed",
    "crashed": "it crashed",
    "": "its manifest is missing or says nothing",
}


@dataclass(frozen=True, slots=True)
class Extent:
    """The part of a run that a log holds.

    Attributes:
        status: of the run, as its manifest says; empty without one.
        ticks: rows of the log.
        until: run time at the end of the last one [s].
        writer: the process that writes it now, in words; empty if none does.
        lost: ticks that are there and cannot be read, and why; empty if there are none.
    """

    status: str
    ticks: int
    until: float
    writer: str = ""
    lost: str = ""

    @property
    def partial(self) -> bool:
        """Whether the run did not come to its end."""
        return self.status not in ENDED

    @property
    def why(self) -> str:
        """What is known of why a run is partial."""
        if self.status == RUNNING and self.writer:
            return f"it still goes on, in {self.writer}"
        return _WHY.get(self.status, f"its manifest says {self.status}")

    @property
    def text(self) -> str:
        """A partial run in one line."""
        return f"the run is partial: {self.why}; {self.holds}"

    @property
    def holds(self) -> str:
        """How far the log goes."""
        if not self.ticks:
            return f"its log holds no tick{self.lost and '; '}{self.lost}"
        text = f"its log holds {self.ticks} ticks, until {self.until:.3f} s"
        return f"{text}; {self.lost}" if self.lost else text


def status_of(manifest: Mapping[str, Any], summary: Mapping[str, Any]) -> str:
    """The status of a run, empty if it has none; a summary is written when the log is whole."""
    return str(summary.get("status") or manifest.get("status") or "")
