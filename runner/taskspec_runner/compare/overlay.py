"""The runs of a comparison laid over each other, so that the same stage is at the same time.

Guards end a stage when they do, so under each law the stage that matters begins at another time of
the run. All runs are shifted to where it begins, which is the zero of the common time.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import Axis
from taskspec.laws import LAWS
from taskspec_runner.compare.attempt import AS_WRITTEN
from taskspec_runner.compare.comparison import Comparison
from taskspec_runner.compare.ranking import ORDER
from taskspec_runner.record.history import Vector
from taskspec_runner.record.visits import StageVisit
from taskspec_runner.report.figures import ANGULAR, LINEAR
from taskspec_runner.runs import Run

#: Colours there are for laws.
COLOURS = 10
#: Runs that are compared by other names than that of a law, and their colours.
RUN_ROLES = {"A": "law0", "B": "law2"}


@dataclass(frozen=True, slots=True)
class Overlay:
    """Runs on a common time.

    Attributes:
        comparison: that they are of.
        lead: the law whose stages and references are drawn.
        origin: the stage that begins at zero, empty where the runs themselves do.
        begins: law to the common time at which its run begins [s].
    """

    comparison: Comparison
    lead: str
    origin: str
    begins: Mapping[str, float]

    @property
    def runs(self) -> Mapping[str, Run]:
        """The runs by law."""
        return self.comparison.runs

    @property
    def leading(self) -> Run:
        """The run whose stages and references are drawn."""
        return self.runs[self.lead]

    @property
    def under(self) -> str:
        """Which run leads, in words: `under LAW`, or `as written`."""
        return self.lead if self.lead == AS_WRITTEN else f"under {self.lead}"

    @property
    def start(self) -> float:
        """Common time at which the first run begins [s]."""
        return min(self.begins[law] + run.start for law, run in self.runs.items())

    @property
    def end(self) -> float:
        """Common time at which the last run ends [s]."""
        return max(self.begins[law] + run.end for law, run in self.runs.items())

    def visits(self) -> list[tuple[StageVisit, float, float]]:
        """The leading run's visits with their common times [s]."""
        begin = self.begins[self.lead]
        return [(v, v.start + begin, v.end + begin) for v in self.leading.visits]

    def force_axes(self) -> list[str]:
        """Axes with a force or moment to reach in some stage, those of the first stage first."""
        forces: Mapping[str, list[str]] = self.comparison.summary["force_axes"]
        known = (*LINEAR, *ANGULAR)
        return list(dict.fromkeys(a for axes in forces.values() for a in axes if a in known))

    def motion_error(self, run: Run, axes: tuple[Axis, ...]) -> Vector:
        """(rows,) Size of the motion error [m, rad] over those axes that no law gives a force.

        Args:
            run: one of them.
            axes: the translations, or the rotations.
        """
        squares = np.zeros(len(run.clock))
        known = np.zeros(len(run.clock), dtype=bool)
        forces: Mapping[str, list[str]] = self.comparison.summary["force_axes"]
        for visit in run.visits:
            rows = run.rows(visit)
            for axis in axes:
                error = run.column(f"error.{axis}")
                if error is None or axis in forces.get(visit.stage, ()):
                    continue
                finite = rows & np.isfinite(error)
                squares[finite] += error[finite] ** 2
                known |= finite
        return np.where(known, np.sqrt(squares), np.nan)


def overlay(comparison: Comparison) -> Overlay | None:
    """Lays the runs of a comparison over each other; None where there is none."""
    if not comparison.runs:
        return None
    lead = _lead(comparison)
    leading = comparison.runs[lead]
    origin = next((s for s in comparison.stages if _first(leading, s) is not None), "")
    if not any(comparison.summary["force_axes"].values()):
        origin = ""
    zero = _first(leading, origin) or 0.0
    begins = {}
    for law, run in comparison.runs.items():
        first = _first(run, origin)
        begins[law] = -(zero if first is None else first)
    return Overlay(comparison, lead, origin, begins)


def role(law: str) -> str:
    """The colour of a law; it has the same in every picture."""
    names = list(LAWS)
    if law == AS_WRITTEN:
        return "ink"
    if law in RUN_ROLES:
        return RUN_ROLES[law]
    return f"law{names.index(law) % COLOURS if law in names else 0}"


def _lead(comparison: Comparison) -> str:
    """The run that shows most of the task: the best outcome, expectations met, stages visited."""
    by_law = {law["law"]: law for law in comparison.laws}

    def worth(law: str) -> tuple[int, int, int]:
        outcome = by_law[law]["outcome"]
        rank = ORDER.index(outcome) if outcome in ORDER else len(ORDER)
        return -rank, by_law[law].get("met", 0), len({v.stage for v in comparison.runs[law].visits})

    return max(comparison.runs, key=worth)


def _first(run: Run, stage: str) -> float | None:
    """Run time at which a stage is first entered [s]; None where it never was."""
    return next((v.start for v in run.visits if v.stage == stage), None)
