"""What slipped in the gripper in a run, or out of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.spec import Task
from taskspec.text.units import show
from taskspec_runner.record.history import History, Visit

#: Pads that bend let a body move less than that [m].
_SLIDES = 0.1e-3


@dataclass(frozen=True, slots=True)
class Slip:
    """A visit in which a body slides on the pads.

    Attributes:
        visit: the visit.
        distance: how far, at most [m].
        lost: whether it slides out, while the gripper is to hold it.
    """

    visit: Visit
    distance: float
    lost: bool


def slips(task: Task, history: History) -> Iterator[Slip]:
    """The first visit of each stage in which a body slides.

    Args:
        task: as the controller has it.
        history: of a run or of a trial.
    """
    signals = [f"grip.{name}" for name in ("force", "slip", "command")]
    if not task.gripped or not {*signals} <= history.columns.keys():
        return
    force, slip, command = (history.columns[name] for name in signals)
    known: set[str] = set()
    for visit in history.visits():
        closed = command[visit.rows] > 0
        # The first tick's command is that of the stage, what is reported belongs to the one before.
        slid = slip[visit.rows][1:][closed[1:]]
        distance = float(np.ptp(slid)) if slid.size else 0.0
        held = (force[visit.rows] > 0) & closed
        lost = bool(held.any() and closed[-1] and force[visit.rows][-1] == 0)
        if visit.stage not in known and (lost or distance > _SLIDES):
            known.add(visit.stage)
            yield Slip(visit, distance, lost)


def slip_block(task: Task, history: History) -> dict[str, Any]:
    """The entry of a summary, `slips`; empty where nothing slides."""
    found = [
        {"stage": each.visit.stage, "distance": each.distance, "lost": each.lost}
        for each in slips(task, history)
    ]
    return {"slips": found} if found else {}


def sentences(summary: Mapping[str, Any]) -> Iterator[str]:
    """Where a body slid on the pads, and where it slid out."""
    for slip in summary.get("slips", ()):
        stage = f"in stage {slip['stage']!r}"
        if slip["lost"]:
            yield f"gripper: what it held slips out {stage}"
        else:
            yield f"gripper: what it holds slips by {show(slip['distance'], 'mm', 2)} {stage}"
