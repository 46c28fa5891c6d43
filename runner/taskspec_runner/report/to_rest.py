"""What a page shows of an arm that was brought to rest after its run: its charts simply go on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from taskspec.text.units import VELOCITY, show
from taskspec_runner.pages.chart import Chart, Section, Trace
from taskspec_runner.pages.timeline import Timeline
from taskspec_runner.record.folder import Json, mapping, number
from taskspec_runner.record.history import TO_REST, History, Vector
from taskspec_runner.runs import Run

#: What its colour is called.
TINT = "rest"


def going_on(run: Run, sections: tuple[Section, ...]) -> tuple[Section, ...]:
    """Charts whose lines go on to rest, where they are of a signal of the log.

    What bounds, references and predictions say is of the run, which is over.
    """
    rest = run.history.rest
    if rest is None:
        return sections
    return tuple(
        Section(each.title, [_chart(run, rest, chart) for chart in each.charts], each.silent)
        for each in sections
    )


def _chart(run: Run, rest: History, chart: Chart) -> Chart:
    traces = tuple(
        replace(trace, values=np.concatenate([trace.values, _values(run, rest, trace)]))
        for trace in chart.traces
    )
    return replace(chart, traces=traces)


def _values(run: Run, rest: History, trace: Trace) -> Vector:
    """(ticks,) of a line on the way to rest, in its chart's unit."""
    after = rest.columns.get(trace.signal)
    before = run.columns.get(trace.signal)
    if after is None or before is None or not np.isfinite(before).any():
        return np.full(len(rest), np.nan)
    # A line is its signal by a factor, which all rows tell alike.
    row = int(np.nanargmax(np.abs(before)))
    factor = float(trace.values[row] / before[row]) if before[row] else np.nan
    return np.asarray(factor * after)


def stretch(run: Run) -> tuple[float, float] | None:
    """Run times from which and to which its arm was brought to rest [s]; None if it was not."""
    rest = run.history.rest
    if rest is None:
        return None
    start, end = (float(rest.columns["clock"][row]) for row in (0, -1))
    return start, end + run.period


def as_stage(run: Run) -> Json:
    """What a page draws where its charts go on: a stage more, and where they end."""
    found = stretch(run)
    if found is None:
        return {}
    stage = {"name": TO_REST, "start": found[0], "end": found[1], "tint": TINT}
    return {"stages": [*Timeline.of(run).stages(), stage], "end": found[1]}


def told(run: Run) -> str:
    """What became of the arm after the run, as a sentence; empty for a run that came to `end`."""
    said = mapping(run.summary.get("stopping"))
    if not said:
        return ""
    duration, why = number(said.get("duration")), str(said.get("not_at_rest") or "")
    if duration is None:
        return f"The arm was not brought to rest after it: {why}." if why else ""
    if why:
        return f"After it the arm was braked for {1e3 * duration:.0f} ms, until {why}."
    after, speed = number(said.get("time_to_rest")), number(said.get("residual_speed")) or 0.0
    came = f"came to rest in {1e3 * after:.0f} ms" if after is not None else "did not come to rest"
    joints = ", ".join(map(str, said.get("undamped") or ()))
    alone = (
        f" Joint {joints} gave no measurement, and was carried without damping." if joints else ""
    )
    return (
        f"After it a stop controller braked the arm for {1e3 * duration:.0f} ms, shaded as "
        f"'{TO_REST}' and judged by nothing: it {came}, and its tool was left with "
        f"{show(speed, VELOCITY, 2)}.{alone}"
    )
