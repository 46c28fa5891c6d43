"""The runs of a comparison laid over each other, so that the same stage is at the same time.

Guards end a stage when they do, so under each law the stage that matters begins at another time of
the run. All runs are shifted to where it begins, which is the zero of the common time.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from taskspec.geometry.axis import Axis
from taskspec.laws import LAWS
from taskspec_runner.compare.attempt import AS_WRITTEN
from taskspec_runner.compare.comparison import Comparison
from taskspec_runner.compare.ranking import ORDER
from taskspec_runner.pages.chart import Chart
from taskspec_runner.pages.samples import page_data
from taskspec_runner.pages.timeline import Timeline
from taskspec_runner.record.folder import Json
from taskspec_runner.record.history import Vector
from taskspec_runner.report.figures import ANGULAR, LINEAR
from taskspec_runner.runs import Run

#: Colours there are for laws.
COLOURS = 10
#: Outcomes that say nothing about how a law would have gone on.
CUT_SHORT = ("failed", "stopped", "crashed", "interrupted")
#: Runs that are compared by other names than that of a law, and their colours.
RUN_ROLES = {"A": "law0", "B": "law2"}


@dataclass(frozen=True, slots=True)
class Overlay(Timeline):
    """Runs on a common time, the one whose stages and references are drawn leading.

    Attributes:
        origin: the stage that begins at zero, empty where the runs themselves do.
        forces: stage to the axes that have a force or moment to reach in some run.
        dashed: runs that are drawn dashed and over the others, such as laws without a force loop.
    """

    origin: str
    forces: Mapping[str, Sequence[str]]
    dashed: Collection[str]

    @property
    def under(self) -> str:
        """Which run leads, in words: `under LAW`, `as written`, or `of A`."""
        if self.lead == AS_WRITTEN:
            return self.lead
        return f"{'of' if self.lead in RUN_ROLES else 'under'} {self.lead}"

    def force_axes(self) -> list[str]:
        """Axes with a force or moment to reach in some stage, those of the first stage first."""
        known = (*LINEAR, *ANGULAR)
        return list(dict.fromkeys(a for axes in self.forces.values() for a in axes if a in known))

    def motion_error(self, run: Run, axes: tuple[Axis, ...]) -> Vector:
        """(rows,) Size of the motion error [m, rad] over those axes that no law gives a force.

        Args:
            run: one of them.
            axes: the translations, or the rotations.
        """
        squares = np.zeros(len(run.clock))
        known = np.zeros(len(run.clock), dtype=bool)
        for visit in run.visits:
            rows = run.rows(visit)
            for axis in axes:
                error = run.column(f"error.{axis}")
                if error is None or axis in self.forces.get(visit.stage, ()):
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
    forces = comparison.summary["force_axes"]
    if not any(forces.values()):
        origin = ""
    zero = _first(leading, origin) or 0.0
    begins = {}
    for law, run in comparison.runs.items():
        first = _first(run, origin)
        begins[law] = -(zero if first is None else first)
    dashed = {law["law"] for law in comparison.laws if not law["force_loop"]}
    return Overlay(comparison.runs, lead, begins, origin, forces, dashed)


def overlay_data(
    laid: Overlay, charts: Sequence[Chart], ends: Iterable[tuple[str, str, str]]
) -> Json:
    """What the script of a page draws.

    Args:
        laid: the runs.
        charts: of them.
        ends: run, outcome and reason of each that was cut short.
    """
    begin = laid.begins[laid.lead]
    events = []
    for visit in laid.leading.visits:
        why = str(visit.ended_by.get("text") or "")
        text = f"{laid.lead}: {visit.stage} ends{f', {why}' if why else ''}"
        events.append({"at": visit.end + begin, "kind": "event", "text": text})
    for name, outcome, reason in ends:
        if name in laid.runs and outcome in CUT_SHORT:
            at = laid.begins[name] + laid.runs[name].end
            events.append({"at": at, "kind": "stop", "text": f"{name} {outcome}: {reason}"})
    return page_data(laid, charts, events)


def role(law: str) -> str:
    """The colour of a law; it has the same in every picture, in which all command the same."""
    names = [each for each in LAWS if law in LAWS and LAWS[each].commands == LAWS[law].commands]
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
