"""What the script of a page draws, as data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from itertools import zip_longest

import numpy as np

from taskspec_runner.record.folder import Json
from taskspec_runner.record.history import Vector
from taskspec_runner.report import decimate
from taskspec_runner.report.chart import Chart, Trace, tints
from taskspec_runner.report.quantities import figure
from taskspec_runner.runs import Run, StageVisit

#: Every tick this long before and after a change of stage is drawn, up to so many changes [s].
DETAIL, CHANGES = (0.1, 0.3), 12


def page_data(run: Run, charts: dict[str, Chart]) -> Json:
    """What the page of a run draws."""
    tint = tints(run)
    return {
        "start": run.start,
        "period": run.period,
        "end": run.end,
        "stages": [
            {"name": run.label(v), "start": v.start, "end": v.end, "tint": tint[v.stage]}
            for v in run.visits
        ],
        "events": [*_endings(run), *_breaks(run)],
        "charts": {key: _chart(run, chart) for key, chart in charts.items()},
    }


def points(run: Run, values: Vector, *, continuous: bool = False) -> Json:
    """A signal in the form in which the script reads it, thinned, with gaps between stages."""
    rows = decimate.decimate(values, run.breaks, keep=detail(run))
    shown = values[rows]
    if not continuous:
        rows, shown = decimate.broken(rows, values, run.breaks)
    return decimate.encode(rows, shown)


def detail(run: Run) -> decimate.Rows:
    """Rows near to changes of stage and to the end, where what happens is short."""
    before, after = (round(side / run.period) for side in DETAIL)
    ends = [*run.breaks[: CHANGES - 1].tolist(), len(run.clock)]
    near = [np.arange(max(at - before, 0), min(at + after, len(run.clock))) for at in ends]
    return np.unique(np.concatenate(near)).astype(np.int64)


def density(run: Run) -> str:
    """How many ticks there are, and how many of them are drawn."""
    rows = len(run.clock)
    text = f"{rows} ticks of {figure(1e3 * run.period)} ms"
    if rows <= decimate.POINTS:
        return f"{text}, all of them drawn."
    width = -(-2 * rows // decimate.POINTS)
    return (
        f"{text}; of every {width} ticks the lowest and the highest value are drawn, and all of "
        "them near changes of stage."
    )


def _chart(run: Run, chart: Chart) -> Json:
    return {
        "unit": chart.unit,
        "log": False,
        "levels": [asdict(level) for level in chart.limits],
        "moments": [asdict(moment) for moment in chart.moments],
        "always": chart.always,
        "traces": [_trace(run, t) for t in chart.traces],
        "bands": [asdict(band) for band in chart.bands],
    }


def _trace(run: Run, trace: Trace) -> Json:
    look = {"label": trace.label, "role": trace.role, "style": trace.style}
    drawn = points(run, trace.values, continuous=trace.continuous)
    return {**look, "reference_of": trace.reference_of, **drawn}


def _endings(run: Run) -> Iterator[Json]:
    for visit, following in zip_longest(run.visits, run.visits[1:]):
        if following is not None or visit.ended_by:
            stopped = visit.ended_by.get("kind") in ("limit", "stop")
            kind = "stop" if stopped else "event"
            yield {"at": visit.end, "kind": kind, "text": _ending(run, visit, following)}


def _ending(run: Run, visit: StageVisit, following: StageVisit | None) -> str:
    to = run.label(following) if following else str(visit.ended_by.get("to") or "stop")
    why = str(visit.ended_by.get("text") or "")
    text = f"{visit.end:.3f} s: {run.label(visit)} → {to}"
    return f"{text}, {why}" if why else text


def _breaks(run: Run) -> Iterator[Json]:
    for each in run.expectations:
        if each.broken is not None:
            text = f"{each.broken.clock:.3f} s: broken, {each.text}"
            yield {"at": each.broken.clock, "kind": "broken", "text": text}
