"""Charts of the world's mechanisms: where each is, and what the robot applies to it."""

from __future__ import annotations

from collections.abc import Sequence

from taskspec_runner.report.chart import Chart, Trace, bands, size
from taskspec_runner.report.quantities import plain_scale, scale
from taskspec_runner.runs import Run

_COORDINATES = ("angle", "travel")


def coordinate_charts(run: Run) -> list[Chart | None]:
    """Angles over several turns, and ways along the axes."""
    return [
        _chart(run, "angle", "Angle", plain=True),
        _chart(run, "travel", "Way along the axis", plain=True),
    ]


def effort_charts(run: Run) -> list[Chart | None]:
    """Moments about the axes, and forces along them."""
    return [
        _chart(run, "torque", "Moment on the mechanism, about its axis"),
        _chart(run, "force", "Force on the mechanism, along its axis"),
    ]


def _chart(run: Run, signal: str, title: str, *, plain: bool = False) -> Chart | None:
    names = [f"{m}.{signal}" for m in _mechanisms(run) if run.column(f"{m}.{signal}") is not None]
    if not names:
        return None
    columns = [run.columns[name] for name in names]
    unit = run.units[names[0]]
    factor, shown = plain_scale(unit, 1.0) if plain else scale(unit, size(columns))
    traces = tuple(
        Trace(name, column * factor, f"j{i % 7}", "line", name, True)
        for i, (name, column) in enumerate(zip(names, columns, strict=True))
    )
    bounds = bands(run, names, factor)
    return Chart(f"mechanism {signal}", title, shown, traces, bands=bounds, factor=factor)


def _mechanisms(run: Run) -> Sequence[str]:
    """Objects that have a coordinate of their own."""
    owners = (name.rpartition(".") for name in run.columns)
    return list(dict.fromkeys(o for o, _, signal in owners if o and signal in _COORDINATES))
