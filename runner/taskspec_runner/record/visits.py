"""Stays of a run in stages: as its summary names them, or as its log shows them."""

from __future__ import annotations

from dataclasses import field

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.folder import Json, mapping, mappings, number
from taskspec_runner.record.history import History


@dataclass(frozen=True, slots=True)
class StageVisit:
    """One stay in a stage.

    Attributes:
        stage: its name.
        number: 1 for the first visit.
        start, end: run time [s].
        law, frame: under and in which it ran, empty where unknown.
        ended_by: the event that ended it, as the summary has it.
    """

    stage: str
    number: int
    start: float
    end: float
    law: str = ""
    frame: str = ""
    ended_by: Json = field(default_factory=dict)


def judged_visits(summary: Json) -> tuple[StageVisit, ...]:
    """The stays that a summary names; none where it does not say when they were."""
    counts: dict[str, int] = {}
    visits = []
    for entry in mappings(summary.get("stages")):
        start, end = number(entry.get("start")), number(entry.get("end"))
        if start is None or end is None:
            return ()
        name = str(entry.get("name", ""))
        counts[name] = counts.get(name, 0) + 1
        law, frame = str(entry.get("law") or ""), str(entry.get("frame") or "")
        ended_by = mapping(entry.get("ended_by"))
        visits.append(StageVisit(name, counts[name], start, end, law, frame, ended_by))
    return tuple(visits)


def logged_visits(history: History) -> tuple[StageVisit, ...]:
    """The stays that a log shows, with what only the summary knows left empty."""
    clock = history.columns.get("clock", np.zeros(0))
    counts: dict[str, int] = {}
    visits = []
    for each in history.visits():
        counts[each.stage] = counts.get(each.stage, 0) + 1
        after = min(each.last + 1, len(clock) - 1)
        start, end = float(clock[each.first]), float(clock[after])
        visits.append(StageVisit(each.stage, counts[each.stage], start, end))
    return tuple(visits)
