"""What stands as an upright line in all charts of a run: ends of stages, breaks, faults."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import zip_longest

from taskspec_runner.record.fault_time import fault_times
from taskspec_runner.record.folder import Json
from taskspec_runner.record.visits import StageVisit
from taskspec_runner.runs import Run


def events(run: Run) -> Iterator[Json]:
    """Times at which something happens [s]; `short` is what stands where there is little room."""
    for visit, following in zip_longest(run.visits, run.visits[1:]):
        if following is not None or visit.ended_by:
            stopped = visit.ended_by.get("kind") in ("limit", "stop")
            kind = "stop" if stopped else "event"
            yield {"at": visit.end, "kind": kind, "text": _ending(run, visit, following)}
    for each in run.expectations:
        if each.broken is not None:
            short = f"{each.broken.clock:.3f} s: broken"
            yield {"at": each.broken.clock, "kind": "broken", "text": f"{short}, {each.text}",
                   "short": short, "of": each.text}  # fmt: skip
    for fault in fault_times(run.summary):
        for at, what, short in (
            (fault.start, "fault", fault.text),
            (fault.end, "end of the fault", "over"),
        ):
            if at is not None:
                text = f"{at:.3f} s: {what}, {fault.text}"
                yield {"at": at, "kind": "fault", "text": text, "short": short}


def fault_spans(run: Run) -> list[tuple[float, float]]:
    """Run times from which and to which faults of the true world lasted [s]."""
    return [
        (each.start, run.end if each.end is None else each.end)
        for each in fault_times(run.summary)
        if each.start is not None
    ]


def _ending(run: Run, visit: StageVisit, following: StageVisit | None) -> str:
    to = run.label(following) if following else str(visit.ended_by.get("to") or "stop")
    why = str(visit.ended_by.get("text") or "")
    text = f"{visit.end:.3f} s: {run.label(visit)} → {to}"
    return f"{text}, {why}" if why else text
