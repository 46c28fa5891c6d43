"""What a chart is made of, and the bounds that a run's values are held against."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from taskspec_runner.pages.numbers import figure, plain_scale, quantity, scale
from taskspec_runner.record.file_array import in_file
from taskspec_runner.record.folder import mapping, number
from taskspec_runner.record.history import Vector
from taskspec_runner.runs import Run
from taskspec_runner.verdict.judged import Judged


@dataclass(frozen=True, slots=True)
class Trace:
    """One line of a chart.

    Attributes:
        label: in the legend.
        values: (rows,) in the chart's unit.
        role: what its colour means.
        style: `line`, `reference` (dashed), `halo` (wide and pale, below the others), `faint`,
            `loopless` (dashed, of a law without a force loop) or `bound`, of an expectation.
        signal: its name in the log.
        continuous: whether it runs on through a change of stage.
        reference_of: label of the trace that it is the reference of and shares a legend entry with.
        run: whose it is, as the chart's timeline has it.
    """

    label: str
    values: Vector
    role: str
    style: str = "line"
    signal: str = ""
    continuous: bool = False
    reference_of: str = ""
    run: str = ""

    def __post_init__(self) -> None:
        # A page has dozens of them, each of every tick.
        object.__setattr__(self, "values", in_file(self.values))


@dataclass(frozen=True, slots=True)
class Band:
    """Values that an expectation allows.

    Attributes:
        start, end: run time [s].
        low, high: in the chart's unit, None on an open side.
        passed: whether the expectation held; None if it cannot be judged.
        text: the expectation.
    """

    start: float
    end: float
    low: float | None
    high: float | None
    passed: bool | None
    text: str


@dataclass(frozen=True, slots=True)
class Level:
    """A value from `start` to `end` [s], in the chart's unit: a limit, or a value at rest.

    Attributes:
        start, end, value, kind, text: see above.
        look: what tells it apart from others of its kind: `rest`.
    """

    start: float
    end: float
    value: float
    kind: str = "limit"
    text: str = "limit"
    look: str = ""


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart over time.

    Attributes:
        key, title, unit, note: as shown.
        traces, bands: in drawing order.
        levels: limits that must not be passed, and values at rest.
        always: values that always stay in view.
        factor: from SI to the unit; 0 where each trace has a factor of its own.
        log: whether its values are sizes over several orders.
        of: the run whose stages it has for its ground; None for the one that leads.
    """

    key: str
    title: str
    unit: str
    traces: tuple[Trace, ...]
    note: str = ""
    bands: tuple[Band, ...] = ()
    levels: tuple[Level, ...] = ()
    always: tuple[float, ...] = ()
    factor: float = 0.0
    log: bool = False
    of: str | None = None


@dataclass(slots=True)
class Section:
    """Charts under one heading; `silent` names those that would show nothing but zero."""

    title: str
    charts: list[Chart] = field(default_factory=list)
    silent: list[str] = field(default_factory=list)

    def add(self, chart: Chart | None) -> None:
        """Takes a chart up if it shows something."""
        if chart is None or not chart.traces:
            return
        if any(np.nanmax(np.abs(t.values)) > 0 for t in chart.traces):
            self.charts.append(chart)
        else:
            self.silent.append(chart.title)


@dataclass(frozen=True, slots=True)
class Drawn:
    """A signal of a run that is to be drawn; attributes as of a `Trace`."""

    signal: str
    role: str
    label: str = ""
    style: str = "line"
    continuous: bool = False
    reference_of: str = ""


def of_signals(
    run: Run,
    key: str,
    title: str,
    lines: Iterable[Drawn],
    note: str = "",
    *,
    places: bool = False,
    always: tuple[float, ...] = (),
) -> Chart | None:
    """A chart of signals in one unit, with what is expected of them; None where none has a value.

    Args:
        run: that they are of.
        key, title, note, always: as of the chart.
        lines: in drawing order; those without a value are left out.
        places: whether they stay in mm or deg however small they are.
    """
    lines = [line for line in lines if run.column(line.signal) is not None]
    if not lines:
        return None
    columns = [run.columns[line.signal] for line in lines]
    factor, unit = (plain_scale if places else scale)(run.units[lines[0].signal], size(columns))
    traces = (
        Trace(x.label or x.signal, factor * column, x.role, x.style, x.signal, x.continuous,
              x.reference_of)
        for x, column in zip(lines, columns, strict=True)
    )  # fmt: skip
    bounds = bands(run, [line.signal for line in lines], factor)
    return Chart(key, title, unit, tuple(traces), note, bounds, always=always, factor=factor)


def bands(run: Run, signals: Iterable[str], factor: float) -> tuple[Band, ...]:
    """Bands of the expectations on some signals; `factor` makes them the chart's unit."""
    wanted = set(signals)
    return tuple(
        Band(start, end, *_sides(each, factor), each.passed, each.text)
        for each in run.expectations
        if each.band is not None and each.signal in wanted
        for start, end in _windows(run, each)
    )


def levels(run: Run, name: str, factor: float, signs: Sequence[int]) -> tuple[Level, ...]:
    """A limit of the task over the run; one piece for each stretch in which it stays the same."""
    pieces: list[tuple[float, float, float]] = []
    for visit in run.visits:
        limit = run.limit(name, visit.stage)
        if limit is None:
            continue
        if pieces and pieces[-1][1:] == (visit.start, limit):
            pieces[-1] = (pieces[-1][0], visit.end, limit)
        else:
            pieces.append((visit.start, visit.end, limit))
    return tuple(
        Level(start, end, sign * factor * limit) for start, end, limit in pieces for sign in signs
    )


def law_levels(
    run: Run, signal: str, factor: float, text: str, signs: Sequence[int] = (1,)
) -> tuple[Level, ...]:
    """What a law promises of a signal, over the visits of its stages, in the chart's unit."""
    by_stage = mapping(run.summary.get("law_bounds"))
    found = list[Level]()
    for visit in run.visits:
        most = number(mapping(by_stage.get(visit.stage)).get(signal))
        if most is not None:
            ends = (visit.start, visit.end)
            found += [Level(*ends, sign * factor * most, text=text) for sign in signs]
    return tuple(found)


def limit_note(run: Run, name: str, unit: str, peak: float) -> str:
    """How near a peak [SI] comes to a limit that is the same in all stages."""
    found = {run.limit(name, visit.stage) for visit in run.visits}
    limit = found.pop() if len(found) == 1 else None
    if not limit:
        return ""
    return (
        f"limit {' '.join(quantity(limit, unit))}, peak at {figure(100 * peak / limit, 2)} % of it"
    )


def size(columns: Sequence[Vector]) -> float:
    """The largest size of all values."""
    return max(float(np.nanmax(np.abs(c))) for c in columns)


def _sides(each: Judged, factor: float) -> tuple[float | None, float | None]:
    low, high = each.band or (None, None)
    return None if low is None else low * factor, None if high is None else high * factor


def _windows(run: Run, each: Judged) -> list[tuple[float, float]]:
    if each.stage is None:
        return [(run.start, run.end)]
    return [(v.start, v.end) for v in run.visits if v.stage == each.stage]
