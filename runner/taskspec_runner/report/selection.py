"""Charts of signals that somebody asked for: those in the same unit together."""

from __future__ import annotations

from collections.abc import Sequence

from taskspec_runner.pages.chart import Chart, Drawn, of_signals
from taskspec_runner.runs import Run

_REFERENCE = ".ref"


def selected(run: Run, names: Sequence[str]) -> list[Chart]:
    """One chart for each unit among the named columns, in the order of their first names."""
    units: dict[str, list[str]] = {}
    for name in dict.fromkeys(names):
        units.setdefault(run.units.get(name, ""), []).append(name)
    return [chart for group in units.values() if (chart := _chart(run, group)) is not None]


def _chart(run: Run, names: Sequence[str]) -> Chart | None:
    drawn = [name for name in names if not name.endswith(_REFERENCE)]
    lines = []
    for number, name in enumerate(names):
        # A reference stands beside what it is of; by itself it is a signal like others.
        beside = name.endswith(_REFERENCE) and name.removesuffix(_REFERENCE) in drawn
        role, style = ("ink", "reference") if beside else (f"j{number % 7}", "line")
        lines.append(Drawn(name, role, style=style))
    places = all(name.startswith("position") for name in names)
    return of_signals(run, names[0], "", lines, places=places)
