"""Charts of how far the tool is from surfaces and from constraint equations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taskspec.text.units import LENGTH
from taskspec_runner.report.chart import Chart, Trace, bands, size
from taskspec_runner.report.quantities import quantity, scale
from taskspec_runner.runs import Run
from taskspec_runner.verdict.metrics import set_points

_GAP = ".gap"


def gap_charts(run: Run) -> list[Chart | None]:
    """Distances from surfaces and equations, and of the joints from equations on them."""
    names = [n for n in run.columns if n.endswith(_GAP) and run.column(n) is not None]
    if not names and run.column("gap") is not None:
        names = ["gap"]
    on_joints = [n for n in names if run.units[n] == "rad"]
    return [
        _chart(run, "gap", [n for n in names if n not in on_joints]),
        _chart(run, "gap of joints", on_joints),
    ]


def _chart(run: Run, key: str, names: Sequence[str]) -> Chart | None:
    if not names:
        return None
    columns = [run.columns[n] for n in names]
    factor, unit = scale(run.units[names[0]], size(columns))
    traces = [
        Trace(n.removesuffix(_GAP), c * factor, f"j{i % 7}", "line", n, True)
        for i, (n, c) in enumerate(zip(names, columns, strict=True))
    ]
    # Off an equation is off it to either side; below a surface is inside.
    equations = {name.partition(".")[0] for name in set_points(run.columns)}
    surfaces = [run.columns[n] for n in names if n.removesuffix(_GAP) not in equations]
    deepest = min((float(np.nanmin(c)) for c in surfaces), default=0.0)
    title, note = "Gap to the surface" if surfaces else "Distance from the constraints", ""
    if deepest < 0:
        note = f"deepest {' '.join(quantity(-deepest, LENGTH))} inside"
    bounds = bands(run, ["gap", *names] if "gap" not in names else names, factor)
    return Chart(key, title, unit, tuple(traces), note, bounds, always=(0.0,), factor=factor)
