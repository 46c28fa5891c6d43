"""Charts of signals that somebody asked for: those in the same unit together."""

from __future__ import annotations

from collections.abc import Sequence

from taskspec_runner.report.chart import Chart, Trace, bands, size
from taskspec_runner.report.quantities import plain_scale, scale
from taskspec_runner.runs import Run

#: Colours there are for signals of one chart.
_COLOURS = 7
_REFERENCE = ".ref"


def selected(run: Run, names: Sequence[str]) -> list[Chart]:
    """One chart for each unit among the named columns, in the order of their first names."""
    units: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        units.setdefault(run.units.get(name, ""), []).append(name)
    return [_chart(run, unit, group) for unit, group in units.items()]


def _chart(run: Run, unit: str, names: Sequence[str]) -> Chart:
    columns = [run.columns[name] for name in names]
    places = all(name.startswith("position") for name in names)
    factor, shown = (plain_scale if places else scale)(unit, size(columns))
    drawn = [name for name in names if not name.endswith(_REFERENCE)]
    traces = []
    for number, (name, values) in enumerate(zip(names, columns, strict=True)):
        # A reference stands beside what it is of; by itself it is a signal like others.
        beside = name.endswith(_REFERENCE) and name.removesuffix(_REFERENCE) in drawn
        role = "ink" if beside else f"j{number % _COLOURS}"
        style = "reference" if beside else "line"
        traces.append(Trace(name, values * factor, role, style, name))
    return Chart(names[0], "", shown, tuple(traces), bands=bands(run, names, factor), factor=factor)
