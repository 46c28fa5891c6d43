"""Bounds of expectations on the charts that draw what they measure, or on charts of their own.

A bound on one plain signal is known from the summary of a run. What is measured of several signals,
or by a mean, follows from the task and the log.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from taskspec_runner.pages.chart import Band, Chart, Section, Trace
from taskspec_runner.record.history import Vector
from taskspec_runner.runs import RebuildError, Run
from taskspec_runner.verdict.course import Courses, MeasuredCourse

_LOG = logging.getLogger(__name__)
#: The section of charts that stand for an expectation.
JUDGED = "Judged"


def with_bounds(run: Run, sections: Sequence[Section]) -> tuple[Section, ...]:
    """The sections with the bounds of the expectations on more than one plain signal.

    A bound goes to the chart that draws what is measured. One that was missed, and that no chart
    draws, gets a chart in the section "Judged". Where the task cannot be had any more, nothing is
    added.
    """
    wanted = [each for each in run.expectations if each.band is None]
    if not wanted or not len(run):
        return tuple(sections)
    try:
        courses = Courses(run.program, run.history)
    except RebuildError:
        return tuple(sections)
    judged = next((s for s in sections if s.title == JUDGED), Section(JUDGED))
    for each in wanted:
        try:
            found = courses.of(each.text)
        # What was judged stands; a chart that cannot be drawn is left out.
        except (ValueError, KeyError, TypeError, IndexError):
            _LOG.warning("the course of '%s' cannot be drawn", each.text, exc_info=True)
            continue
        for course in found:
            bounded = any([_add(run, s, course, passed=not each.missed) for s in sections])
            if not bounded and each.missed and np.isfinite(course.values).any():
                judged.charts.append(_own(run, course))
    return tuple(sections) if judged in sections or not judged.charts else (*sections, judged)


def _add(run: Run, section: Section, course: MeasuredCourse, *, passed: bool) -> bool:
    """Adds the bounds of a course to the charts of a section that draw what it measures."""
    added = False
    for number, chart in enumerate(section.charts):
        if chart.factor and course.signal in {trace.signal for trace in chart.traces}:
            factor = chart.factor / course.factor
            bands, traces = _bounds(run, course, factor, passed=passed)
            section.charts[number] = replace(
                chart, bands=(*chart.bands, *bands), traces=(*chart.traces, *traces)
            )
            added = True
    return added


def _own(run: Run, course: MeasuredCourse) -> Chart:
    """The chart of a course that was missed."""
    bands, traces = _bounds(run, course, 1.0, passed=False)
    line = Trace(course.label, course.values, "ink", "line", course.signal)
    note = "the last value of this line is judged" if course.grows else ""
    key = f"judged {course.text} {course.label}"
    return Chart(key, course.label, course.unit, (line, *traces), note, tuple(bands))


def _bounds(
    run: Run, course: MeasuredCourse, factor: float, *, passed: bool
) -> tuple[list[Band], list[Trace]]:
    """Bounds that stay as areas, those that change with time as lines."""
    sides = [None if s is None else factor * s for s in (course.low, course.high)]
    spans = list(_spans(sides))
    clock = np.asarray(run.clock)
    bands = []
    for first, last in spans:
        ends = [None if s is None else (s[first], np.ptp(s[first : last + 1])) for s in sides]
        if any(end is not None and end[1] > 1e-12 * max(1.0, abs(end[0])) for end in ends):
            continue
        low, high = (None if end is None else float(end[0]) for end in ends)
        start, end = float(clock[first]), float(clock[last]) + run.period
        bands.append(Band(start, end, low, high, passed, course.text))
    if len(bands) == len(spans):
        return bands, []
    role = "good" if passed else "bad"
    return [], [Trace(course.text, s, role, "bound") for s in sides if s is not None]


def _spans(sides: Sequence[Vector | None]) -> Iterator[tuple[int, int]]:
    """First and last rows of the stretches in which there are bounds."""
    known = reduce(np.logical_or, (np.isfinite(s) for s in sides if s is not None))
    inside = (np.flatnonzero(known[1:] != known[:-1]) + 1).tolist()
    edges = [*([0] if known[0] else []), *inside, *([len(known)] if known[-1] else [])]
    yield from ((int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True))
