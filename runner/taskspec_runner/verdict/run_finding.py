"""Something that is wrong with a run, as it is found and as the summary of the run keeps it."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.folder import Json, number


@dataclass(frozen=True, slots=True)
class RunFinding:
    """Something that is wrong with a run.

    Attributes:
        kind: `oscillation` or `saturation`.
        stage: in which it is.
        visit: of that stage, from 1.
        signal: that shows it most.
        beside: the others that show it.
        start, end: run time of the ticks that were analysed [s].
        text: in one line, with the numbers.
        allowed: whether the stage says so.
        frequency: of an oscillation [Hz].
        amplitude: of it [SI].
        growth: its factor in a quarter of the visit.
        share: of the ticks that a saturation takes.
    """

    kind: str
    stage: str
    visit: int
    signal: str
    beside: tuple[str, ...]
    start: float
    end: float
    text: str
    allowed: bool
    frequency: float | None = None
    amplitude: float | None = None
    growth: float | None = None
    share: float | None = None

    @property
    def line(self) -> str:
        """The stage and what is wrong in it."""
        return f"{self.stage}: {self.text}"

    def as_data(self) -> dict[str, Any]:
        """The entry of a summary."""
        return {**asdict(self), "beside": list(self.beside)}


def read_finding(entry: Json) -> RunFinding:
    """A finding, of whatever a summary says of it."""
    numbers = {n: number(entry.get(n)) for n in ("frequency", "amplitude", "growth", "share")}
    beside = entry.get("beside")
    visit = entry.get("visit")
    return RunFinding(
        kind=str(entry.get("kind", "")),
        stage=str(entry.get("stage", "")),
        visit=visit if isinstance(visit, int) else 1,
        signal=str(entry.get("signal", "")),
        beside=tuple(map(str, beside)) if isinstance(beside, list) else (),
        start=number(entry.get("start")) or 0.0,
        end=number(entry.get("end")) or 0.0,
        text=str(entry.get("text", "")),
        allowed=bool(entry.get("allowed")),
        **numbers,
    )
