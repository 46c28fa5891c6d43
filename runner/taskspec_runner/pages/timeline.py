"""The time axis that charts have in common: that of one run, or of several laid over each other."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from taskspec_runner.record.folder import Json
from taskspec_runner.runs import Run

#: Tints of stages there are; names beyond that share them.
TINTS = 8


def tints(run: Run) -> Mapping[str, int]:
    """Number of the tint of each stage, in the order of first visits."""
    names = dict.fromkeys(v.stage for v in run.visits)
    return {name: i % TINTS for i, name in enumerate(names)}


@dataclass(frozen=True, slots=True)
class Timeline:
    """Runs on a common time.

    Attributes:
        runs: by the names that traces have them by.
        lead: name of the run whose stages are drawn.
        begins: name to the common time at which its clock is zero [s].
    """

    runs: Mapping[str, Run]
    lead: str
    begins: Mapping[str, float]

    @staticmethod
    def of(run: Run) -> Timeline:
        """That of a single run."""
        return Timeline({"": run}, "", {"": 0.0})

    @property
    def leading(self) -> Run:
        """The run whose stages are drawn."""
        return self.runs[self.lead]

    @property
    def start(self) -> float:
        """Common time at which the first run begins [s]."""
        return min(self.begins[name] + run.start for name, run in self.runs.items())

    @property
    def end(self) -> float:
        """Common time at which the last run ends [s]."""
        return max(self.begins[name] + run.end for name, run in self.runs.items())

    def stages(self, of: str | None = None) -> list[Json]:
        """A run's visits of stages: `name`, `tint`, `start` and `end` [s].

        Args:
            of: name of the run; None for the one that leads.
        """
        name = self.lead if of is None else of
        run, begin = self.runs[name], self.begins[name]
        tint = tints(run)
        return [
            {
                "name": run.label(visit),
                "tint": tint[visit.stage],
                "start": visit.start + begin,
                "end": visit.end + begin,
            }
            for visit in run.visits
        ]
