"""What the script of a page draws, as data."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from taskspec_runner.pages import decimate
from taskspec_runner.pages.chart import Chart, Trace
from taskspec_runner.pages.numbers import figure
from taskspec_runner.pages.timeline import Timeline
from taskspec_runner.record.file_array import blocks
from taskspec_runner.record.folder import Json
from taskspec_runner.record.history import Vector
from taskspec_runner.runs import Run

#: Every tick this long before and after a change of stage is drawn, up to so many changes [s].
DETAIL, CHANGES = (0.1, 0.3), 12
#: Room for values in a page, and what a value takes in it: alone, and with its row [bytes].
POINTS_BYTES, _TICK, _POINT = 3_600_000, 6, 8


def page_data(time: Timeline, charts: Iterable[Chart], events: Iterable[Json], **more: Any) -> Json:
    """What the script of a page draws.

    Args:
        time: of the runs that the charts are of.
        charts: each goes by its key.
        events: times of all charts: `at`, `kind`, `text`, and what else the script takes.
        more: what else the script is to know, and what it is to know otherwise.
    """
    samples = Samples()
    drawn = {chart.key: _chart(time, chart, samples) for chart in charts}
    return {
        "samples": samples.data(),
        "start": time.start,
        "period": time.leading.period,
        "end": time.end,
        "linked": len(time.runs) > 1,
        "stages": time.stages(),
        "events": list(events),
        "faults": [],
        "charts": drawn,
        **more,
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

    def data(self) -> list[Json]:
        """All of them in order, as the script reads them."""
        whole = sum(_TICK * len(each[2]) for each in self._signals.values()) <= POINTS_BYTES
        limit = None if whole else points_of(len(self._signals))
        return [
            {**_sample(run, values, limit, continuous=continuous), "start": start}
            for _, run, values, continuous, start in self._signals.values()
        ]


def points_of(signals: int) -> int:
    """How many points of each signal there is room for."""
    return max(POINTS_BYTES // (_POINT * max(signals, 1)), decimate.POINTS)


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


def density(run: Run, samples: list[Json]) -> str:
    """How many ticks there are, and how many of them are drawn."""
    rows = len(run.clock)
    text = f"{rows} ticks of {figure(1e3 * run.period)} ms"
    if all(sample["kind"] == "all" for sample in samples):
        return f"{text}, all of them drawn."
    width = -(-2 * rows // points_of(len(samples)))
    start = float(np.floor((run.start + run.end) / 2))
    return (
        f"{text}; of every {width} ticks the lowest and the highest value are drawn, and all of "
        "them near changes of stage. Every tick of a window: taskspec export "
        f"{run.folder.name} --csv --from {start:g} --to {start + 1:g}"
    )


def _chart(time: Timeline, chart: Chart, samples: Samples) -> Json:
    own = {} if chart.of is None else {"visits": time.stages(chart.of)}
    return own | {
        "unit": chart.unit,
        "log": chart.log,
        "levels": [asdict(level) for level in chart.levels],
        "always": chart.always,
        "traces": [_trace(time, trace, samples) for trace in chart.traces],
        "bands": [asdict(band) for band in chart.bands],
    }


def _trace(time: Timeline, trace: Trace, samples: Samples) -> Json:
    run = time.runs[trace.run]
    start = time.begins[trace.run] + run.start
    return {
        "label": trace.label,
        "role": trace.role,
        "style": trace.style,
        "reference_of": trace.reference_of,
        "sample": samples.add(run, trace.values, continuous=trace.continuous, start=start),
    }
