"""What the script of a page draws, as data."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import asdict
from itertools import zip_longest

import numpy as np

from taskspec_runner.record.fault_time import fault_times
from taskspec_runner.record.file_array import blocks
from taskspec_runner.record.folder import Json
from taskspec_runner.record.history import Vector
from taskspec_runner.record.visits import StageVisit
from taskspec_runner.report import decimate, to_rest
from taskspec_runner.report.chart import Chart, Trace, tints
from taskspec_runner.report.quantities import figure
from taskspec_runner.runs import Run

#: Every tick this long before and after a change of stage is drawn, up to so many changes [s].
DETAIL, CHANGES = (0.1, 0.3), 12
#: Room for values in a page, and what a value takes in it: alone, and with its row [bytes].
POINTS_BYTES, _TICK, _POINT = 3_600_000, 6, 8


def page_data(run: Run, charts: dict[str, Chart]) -> Json:
    """What the page of a run draws."""
    tint, samples = tints(run), Samples()
    _, end = to_rest.stretch(run) or (run.start, run.end)
    drawn = {key: _chart(run, chart, samples) for key, chart in charts.items()}
    return {
        "samples": samples.data(),
        "points": samples.limit,
        "start": run.start,
        "period": run.period,
        "end": end,
        "stages": [
            {"name": run.label(v), "start": v.start, "end": v.end, "tint": tint[v.stage]}
            for v in run.visits
        ]
        + list(to_rest.stage_rows(run)),
        "events": [*_endings(run), *_breaks(run), *_begun(run)],
        "faults": [
            {"start": each.start, "end": run.end if each.end is None else each.end}
            for each in fault_times(run.summary)
            if each.start is not None
        ],
        "charts": drawn,
    }


class Samples:
    """The values that the lines of a page are drawn through, each signal once.

    Every tick is kept where all of them together are small enough for a page; else of each signal
    as many points as there is room for, with the extremes between them.
    """

    def __init__(self) -> None:
        self._signals: dict[bytes, tuple[int, Run, Vector, bool, float]] = {}

    def add(self, run: Run, values: Vector, *, continuous: bool, start: float) -> int:
        """Takes a signal up.

        Args:
            run: that it is from.
            values: (rows,) of it.
            continuous: whether its line runs on from stage to stage.
            start: time of its first row on the page [s].

        Returns:
            Its number.
        """
        mark = hashlib.sha256(repr((continuous, start, id(run))).encode())
        for part in blocks(len(values)):
            mark.update(values[part].astype("<f4").tobytes())
        number = len(self._signals)
        found = self._signals.setdefault(mark.digest(), (number, run, values, continuous, start))
        return found[0]

    @property
    def limit(self) -> int:
        """How many points of a signal there is room for."""
        return max(POINTS_BYTES // (_POINT * max(len(self._signals), 1)), decimate.POINTS)

    def data(self) -> list[Json]:
        """All of them in order, as the script reads them."""
        whole = sum(_TICK * len(each[2]) for each in self._signals.values()) <= POINTS_BYTES
        limit = None if whole else self.limit
        return [
            {**_sample(run, values, limit, continuous=continuous), "start": start}
            for _, run, values, continuous, start in self._signals.values()
        ]


def _sample(run: Run, values: Vector, limit: int | None, *, continuous: bool) -> Json:
    """A signal with every tick, or thinned to about `limit` points; `gaps` break its line."""
    breaks = run.breaks
    if len(values) > len(run.clock):
        breaks = np.append(breaks, len(run.clock))
    if limit is None or len(values) <= limit:
        rows = np.arange(len(values), dtype=np.int64)
    else:
        rows = decimate.decimate(values, breaks, limit, keep=detail(run))
    gaps = np.searchsorted(rows, [] if continuous else breaks)
    inside = np.unique(gaps[(gaps > 0) & (gaps < len(rows))])
    return {**decimate.encode(rows, values[rows]), "gaps": inside.tolist()}


def detail(run: Run) -> decimate.Rows:
    """Rows near to changes of stage and to the end, where what happens is short."""
    before, after = (round(side / run.period) for side in DETAIL)
    ends = [*run.breaks[: CHANGES - 1].tolist(), len(run.clock)]
    near = [np.arange(max(at - before, 0), min(at + after, len(run.clock))) for at in ends]
    return np.unique(np.concatenate(near)).astype(np.int64)


def density(run: Run, data: Json) -> str:
    """How many ticks there are, and how many of them are drawn."""
    rows = len(run.clock)
    text = f"{rows} ticks of {figure(1e3 * run.period)} ms"
    if all(sample["kind"] == "all" for sample in data["samples"]):
        return f"{text}, all of them drawn."
    width = -(-2 * rows // data["points"])
    start = float(np.floor((run.start + run.end) / 2))
    return (
        f"{text}; of every {width} ticks the lowest and the highest value are drawn, and all of "
        "them near changes of stage. Every tick of a window: taskspec export "
        f"{run.folder.name} --csv --from {start:g} --to {start + 1:g}"
    )


def _chart(run: Run, chart: Chart, samples: Samples) -> Json:
    return {
        "unit": chart.unit,
        "log": False,
        "levels": [asdict(level) for level in chart.limits],
        "moments": [asdict(moment) for moment in chart.moments],
        "always": chart.always,
        "traces": [_trace(run, t, samples) for t in chart.traces],
        "bands": [asdict(band) for band in chart.bands],
    }


def _trace(run: Run, trace: Trace, samples: Samples) -> Json:
    look = {"label": trace.label, "role": trace.role, "style": trace.style}
    number = samples.add(run, trace.values, continuous=trace.continuous, start=run.start)
    return {**look, "reference_of": trace.reference_of, "sample": number}


def _endings(run: Run) -> Iterator[Json]:
    for visit, following in zip_longest(run.visits, run.visits[1:]):
        if following is not None or visit.ended_by:
            stopped = visit.ended_by.get("kind") in ("limit", "stop")
            kind = "stop" if stopped else "event"
            text = _ending(run, visit, following)
            yield {"at": visit.end, "kind": kind, "text": text}


def _ending(run: Run, visit: StageVisit, following: StageVisit | None) -> str:
    to = run.label(following) if following else str(visit.ended_by.get("to") or "stop")
    why = str(visit.ended_by.get("text") or "")
    text = f"{visit.end:.3f} s: {run.label(visit)} → {to}"
    return f"{text}, {why}" if why else text


def _begun(run: Run) -> Iterator[Json]:
    """Where faults of the true world begin and end."""
    for each in fault_times(run.summary):
        if each.start is not None:
            text = f"{each.start:.3f} s: fault, {each.text}"
            yield {"at": each.start, "kind": "fault", "text": text, "short": each.text}
        if each.end is not None:
            text = f"{each.end:.3f} s: end of the fault, {each.text}"
            yield {"at": each.end, "kind": "fault", "text": text, "short": "over"}


def _breaks(run: Run) -> Iterator[Json]:
    for each in run.expectations:
        if each.broken is not None:
            yield {
                "at": each.broken.clock,
                "kind": "broken",
                "text": f"{each.broken.clock:.3f} s: broken, {each.text}",
                "short": f"{each.broken.clock:.3f} s: broken",
                "of": each.text,
            }
