"""The page of a run that goes on: verdict so far, charts of its last seconds."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from markupsafe import Markup

from taskspec.deferred_methods import dataclass
from taskspec.geometry.axis import AXES, ROTATIONS, TRANSLATIONS
from taskspec.spec import Task
from taskspec_runner.live.sliders import slider_section, sliders_of
from taskspec_runner.pages.chart import Chart
from taskspec_runner.pages.document import (
    Cells,
    bar,
    document,
    figure,
    head,
    mark,
    named,
    outcome,
    pairs,
    section,
    sign,
    table,
)
from taskspec_runner.pages.html import element, joined, prose
from taskspec_runner.pages.numbers import plain_scale
from taskspec_runner.runs import Run
from taskspec_runner.verdict.judged import Judged
from taskspec_runner.verdict.metrics import set_points
from taskspec_runner.verdict.outcome import verdict

#: The charts show so much of the run [s].
LAST = 10.0
#: Forces and errors of motion are of this size: their charts are in N, mm and deg.
_USUAL = 1.0


@dataclass(frozen=True, slots=True)
class LiveTrace:
    """A line of a chart that grows.

    Attributes:
        column: of the log.
        label, role, style: as of a `Trace`.
        factor: from SI to the unit of the chart.
        reference_of: as of a `Trace`.
    """

    column: str
    label: str
    role: str
    factor: float
    style: str = "line"
    reference_of: str = ""


@dataclass(frozen=True, slots=True)
class LiveChart:
    """A chart that grows; attributes as of a `Chart`."""

    key: str
    title: str
    unit: str
    traces: tuple[LiveTrace, ...]


def live_charts(units: Mapping[str, str]) -> tuple[LiveChart, ...]:
    """The charts of a run, by the columns that its log will have, each with its unit."""
    forces, moments = (
        [f"{kind}.{axis}" for axis in axes if f"{kind}.{axis}" in units]
        for kind, axes in (("force", TRANSLATIONS), ("torque", ROTATIONS))
    )
    found = (
        ("force", "Force", forces),
        ("torque", "Moment", moments),
        ("efforts", "Efforts of constraints", set_points(units)),
        ("position error", "Position error", [f"error.{axis}" for axis in TRANSLATIONS]),
        ("orientation error", "Orientation error", [f"error.{axis}" for axis in ROTATIONS]),
        ("joint error", "Joint error", ["joint_error"]),
    )
    charts = (_chart(key, title, names, units) for key, title, names in found)
    return tuple(chart for chart in charts if chart.traces)


_ROLES: dict[str, str] = {axis: axis.letter for axis in AXES}


def _chart(key: str, title: str, names: Iterable[str], units: Mapping[str, str]) -> LiveChart:
    """Signals of one unit, each over the wide pale line of its reference if it has one."""
    known = [name for name in names if name in units]
    factor, unit = plain_scale(units[known[0]], _USUAL) if known else (1.0, "")
    lines: list[LiveTrace] = []
    for number, name in enumerate(known):
        owner, _, last = name.rpartition(".")
        label = last if last in _ROLES else owner or name.replace("_", " ")
        role = _ROLES.get(last, f"j{number % 7}")
        if f"{name}.ref" in units:
            lines.append(LiveTrace(f"{name}.ref", "ref", role, factor, "halo", label))
        lines.append(LiveTrace(name, label, role, factor))
    # Wide lines below all others.
    return LiveChart(key, title, unit, tuple(sorted(lines, key=lambda line: line.style != "halo")))


def live_page(
    task: Task,
    charts: Sequence[LiveChart],
    stages: Sequence[str],
    period: float,
    arm: Markup | None = None,
) -> str:
    """The page of a run.

    Args:
        task: that is run.
        arm: the figure of its scene, if it can be drawn.
        charts: in the order of the page; rows of the run have the values of their traces in order.
        stages: names, by the numbers that rows have.
        period: of control [s].
    """
    numbers = iter(range(sum(len(chart.traces) for chart in charts)))
    drawn = {chart.key: _drawn(chart, numbers) for chart in charts}
    sliders = sliders_of(task.live)
    data = {
        "samples": [{"kind": "all", "values": "", "gaps": [], "start": 0.0}],
        "start": 0.0,
        "end": LAST,
        "period": period,
        "linked": False,
        "stages": [],
        "events": [],
        "faults": [],
        "charts": drawn,
        "names": list(stages),
        "last": LAST,
        **({"sliders": list(map(asdict, sliders))} if sliders else {}),
    }
    places = [figure(Chart(c.key, c.title, c.unit, ())) for c in charts]
    facts = [
        (name, element("output", "–", id=key))
        for name, key in (("Time", "time"), ("Stage", "stage"), ("Speed", "speed"))
    ]
    waiting = outcome("done", "Starting", element("p", "The run has not begun."))
    return document(
        f"{task.name}: live",
        head(
            "taskspec run, live",
            task.name,
            task.about or "",
            element("div", waiting, id="verdict", aria_live="polite"),
            pairs(facts, "facts"),
        ),
        slider_section(sliders),
        bar([], f"Last {LAST:g} s"),
        section("", joined(arm, *places[:1]), look="charts main front"),
        section("", *places[1:], look="charts") if places[1:] else Markup(""),
        element("div", id="expectations"),
        data=data,
        scripts=(
            "samples",
            "plot",
            "legend",
            "time",
            "scene",
            "live",
            *["sliders"] * bool(sliders),
        ),
        facts=Markup(""),
    )


def _drawn(chart: LiveChart, numbers: Iterator[int]) -> Mapping[str, Any]:
    traces = [
        {**asdict(trace), "sample": 0, "number": next(numbers)} for trace in chart.traces
    ]  # fmt: skip
    return {
        "unit": chart.unit,
        "log": False,
        "levels": [],
        "bands": [],
        "always": [0.0],
        "traces": traces,
    }


def so_far(judged: Sequence[Judged], stage: str) -> Mapping[str, Any]:
    """What a page shows of a run that goes on: its verdict on the ticks that there are.

    Args:
        judged: the expectations of the task on these ticks.
        stage: the current one.
    """
    met = sum(each.passed is True for each in judged)
    # Of a share, a mean or a last value this may still change: it is no verdict.
    missed = sum(each.broken is not None for each in judged)
    text = f"In stage {stage}."
    if judged:
        parts = [f"{met} of {len(judged)} expectations are met"]
        rest = len(judged) - met - missed
        parts += [f"{missed} missed"] if missed else []
        parts += [f"{rest} cannot be judged yet"] if rest else []
        text += f" So far {', '.join(parts)}."
    box = outcome("undecided" if missed else "done", "Running", element("p", text))
    return {"box": box, "expectations": _expectations(judged, pale=True), "over": False}


def judging() -> Mapping[str, Any]:
    """What a page shows of a run whose last tick has been."""
    text = "The last tick has been. The run is judged now, and its report follows."
    return {"box": outcome("done", "Judging", element("p", text)), "over": False}


def at_end(run: Run) -> Mapping[str, Any]:
    """What a page shows of a run that has ended."""
    said = verdict(run)
    link = None
    if run.report is not None:
        link = element("a", "Open the report", href=run.report.name, class_="open")
    word = sign(said.kind) + said.kind
    box = outcome(said.kind, word, element("p", prose(said.sentence)), beside=link)
    whole = said.kind in ("passed", "missed", "done")
    return {
        "box": box,
        "expectations": _expectations(run.expectations, pale=not whole),
        "over": True,
    }


def _expectations(judged: Sequence[Judged], *, pale: bool) -> Markup:
    rows = [
        Cells(
            [
                mark(bool(each.passed)) if each.passed or each.broken else sign("undecided"),
                named(each.name, each.text),
                prose(each.explanation),
            ],
            "good" if each.passed else "bad" if each.broken else "open",
        )
        for each in judged
    ]
    look = "judged expectations" + " pale" * pale
    return section("Expectations", table(["", "Expected", "Measured"], rows, look), look="first")
