"""The picture of a comparison: force and motion error of all laws, for a README or a paper."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec_runner.compare.charts import Overlaid, main_charts
from taskspec_runner.compare.comparison import Comparison
from taskspec_runner.compare.overlay import Overlay, overlay, role
from taskspec_runner.record.history import Vector
from taskspec_runner.report.chart import tints
from taskspec_runner.report.drawing import Panel, Stroke, path_data
from taskspec_runner.report.plane import PlotPlane, Times
from taskspec_runner.report.template import template

WIDTH = 860
_LEFT, _RIGHT, _BOTTOM = 62.0, 20.0, 48.0
#: Height of a panel, and of the room above it for its title [px].
_PANEL, _TITLE = 170.0, 40.0
#: Room above and below the values of a panel, as a share of their range.
_ROOM = 0.05
#: Where the legend begins, the height of its rows, and how many laws stand in one [px].
_LEGEND, _ROW, _COLUMNS = 62.0, 20.0, 3
#: Logarithmic panels with fewer powers of ten get marks between them.
_FEW_DECADES = 2.5
#: Outcomes that say nothing about how a law would have gone on.
CUT_SHORT = ("failed", "stopped", "crashed", "interrupted")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
HERE = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class LegendEntry:
    """A law in the legend, at a place in pixels; `style` is empty where it has no line."""

    x: float
    y: float
    law: str
    role: str
    style: str
    ending: str
    kind: str


def picture_svg(comparison: Comparison) -> str:
    """The picture as text, 860 px wide, for light and dark pages."""
    laid = overlay(comparison)
    found = main_charts(laid) if laid else []
    entries = _legend(comparison)
    top = _LEGEND + _ROW * math.ceil(len(entries) / _COLUMNS) + _TITLE
    width = WIDTH - _LEFT - _RIGHT
    times = Times(laid.start, laid.end, _LEFT, width) if laid else None
    panels = []
    for number, chart in enumerate(found):
        assert laid is not None
        assert times is not None
        panels.append(_panel(laid, chart, top + number * (_PANEL + _TITLE), times))
    bottom = top + len(panels) * (_PANEL + _TITLE) - _TITLE
    return template("compare.svg.j2", HERE).render(
        width=WIDTH,
        height=bottom + (_BOTTOM if panels else 0),
        title=str(comparison.summary["task"]),
        subtitle=_subtitle(comparison, laid),
        entries=entries,
        panels=panels,
        stages=_stages(laid, times) if laid and times else [],
        bottom=bottom,
        middle=_LEFT + width / 2,
        times=times.marks(9) if times else [],
        time=time_of(laid) if laid else "",
        loopless=any(e.style == "loopless" for e in entries),
    )


def time_of(laid: Overlay) -> str:
    """What the common time counts from."""
    return f"time since {laid.origin} began" if laid.origin else "time since the run began"


def _subtitle(comparison: Comparison, laid: Overlay | None) -> str:
    outcomes = [law["outcome"] for law in comparison.laws]
    parts = [
        comparison.summary["robot"],
        f"as written and {len(outcomes) - 1} laws: {counted(outcomes)}",
    ]
    if laid is not None:
        parts.append(f"stages {laid.under}")
    return ", ".join(p for p in parts if p)


def counted(words: Sequence[str]) -> str:
    """How often each word comes, such as `3 passed, 1 refused`."""
    return ", ".join(f"{words.count(word)} {word}" for word in dict.fromkeys(words))


def _legend(comparison: Comparison) -> list[LegendEntry]:
    step = (WIDTH - 40) / _COLUMNS
    return [
        LegendEntry(
            20 + step * (number % _COLUMNS),
            _LEGEND + _ROW * (number // _COLUMNS),
            law["law"],
            role(law["law"]),
            ("line" if law["force_loop"] else "loopless") if law["folder"] else "",
            _ending(law),
            law["outcome"],
        )
        for number, law in enumerate(comparison.laws)
    ]


def _ending(law: Mapping[str, object]) -> str:
    if law["outcome"] == "refused":
        return f"refused, {str(law['reason']).partition(':')[0]}"
    if law["outcome"] in ("stopped", "failed"):
        return f"{law['outcome']} {str(law['reason']).partition(' at ')[0].replace('stage ', '')}"
    if law.get("expected"):
        return f"{law['outcome']}, {law['met']} of {law['expected']}"
    return str(law["outcome"])


def _panel(laid: Overlay, chart: Overlaid, y: float, times: Times) -> Panel:
    cut = {law["law"] for law in laid.comparison.laws if law["outcome"] in CUT_SHORT}
    plane = PlotPlane.around(times, _in_view(chart, cut), y, _PANEL, _ROOM)
    lines = []
    for curve in chart.curves:
        run, begin = laid.runs[curve.law], laid.begins[curve.law]
        values = np.log10(curve.values) if chart.log else curve.values
        points = plane.points(run.clock + begin, values, run.breaks, run.breaks)
        lines.append(Stroke(path_data(points), curve.role, curve.style, curve.label))
        if curve.law in cut and curve.label == curve.law:
            lines.append(_cross(points, curve.role, (y, y + _PANEL)))
    # Whether an expectation was met differs between the laws.
    areas = tuple(plane.area(band, None, laid.begins[laid.lead]) for band in chart.bands)
    marks = plane.marks(_decades(plane.low, plane.high) if chart.log else plane.round(6))
    title, unit = chart.title, chart.unit
    return Panel(title, unit, _LEFT, y, times.width, _PANEL, tuple(lines), marks, areas)


def _cross(points: Vector, role: str, rows: tuple[float, float]) -> Stroke:
    """Marks where the line of a run ends that was cut short; at the edge if that is not in view."""
    x, y = points[np.isfinite(points).all(axis=1)][-1]
    y = min(max(y, rows[0] + 5), rows[1] - 5)
    return Stroke(f"M{x - 4:.1f},{y - 4:.1f}l8,8m0,-8l-8,8", role, "cross")


def _in_view(chart: Overlaid, cut: Collection[str]) -> Vector:
    """Values that are all shown: of the runs that came to their end, if there are any."""
    shown = [c.values for c in chart.curves if c.law not in cut] or [
        c.values for c in chart.curves
    ]  # fmt: skip
    values = np.concatenate([c[np.isfinite(c)] for c in shown])
    return np.log10(values) if chart.log else values


def _decades(low: float, high: float) -> list[tuple[float, str]]:
    """Marks between two logarithms: powers of ten, with 2 and 5 times them where few."""
    leading = (1, 2, 5) if high - low < _FEW_DECADES else (1,)
    found = [(n, m) for n in range(math.floor(low), math.ceil(high) + 1) for m in leading]
    marks = [(n + math.log10(m), _power(m, n)) for n, m in found]
    return [(at, text) for at, text in marks if low <= at <= high]


def _power(leading: int, exponent: int) -> str:
    """Such as 10⁻³ or 2·10⁻³."""
    power = f"10{str(exponent).translate(_RAISED)}"
    return power if leading == 1 else f"{leading}·{power}"


def _stages(laid: Overlay, times: Times) -> list[dict[str, object]]:
    run = laid.leading
    return [
        times.stage(run.label(visit), tints(run)[visit.stage], start, end)
        for visit, start, end in laid.visits()
    ]
