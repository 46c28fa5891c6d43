"""A picture of a run for a README: force against reference, the motion below, the path beside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from taskspec_runner.record.fault_time import fault_times
from taskspec_runner.record.history import Vector
from taskspec_runner.record.visits import StageVisit
from taskspec_runner.record.whole import write_whole
from taskspec_runner.report import figures
from taskspec_runner.report.chart import Chart, size, tints
from taskspec_runner.report.drawing import Panel, Stroke, Tick, path_data, tick_text, ticks
from taskspec_runner.report.plane import PlotPlane, Times
from taskspec_runner.report.template import template
from taskspec_runner.runs import Run
from taskspec_runner.verdict.limit_effects import held_joints
from taskspec_runner.verdict.outcome import verdict

WIDTH = 860
_LEFT, _RIGHT, _TOP, _BOTTOM = 58.0, 24.0, 92.0, 44.0
#: Height of a panel and room above it for its title [px].
_PANEL, _TITLE = 138.0, 40.0
#: Edge of the square that shows the path [px]; both directions must span this much [mm].
_SQUARE, _LEAST_SPAN = 240.0, 5.0
#: Ticks from which on a path is drawn through every second one, and so on.
_PATH_TICKS = 100_000
#: Room above and below the values of a panel, as a share of their range.
_ROOM = 0.07
#: Share of the largest force from which on an axis is worth a line.
_BORNE = 0.05


class Picture:
    """A drawing that notebooks show.

    Attributes:
        svg: the drawing as text.
    """

    def __init__(self, svg: str) -> None:
        self.svg = svg

    def save(self, path: str | Path) -> Path:
        """Writes it as an SVG file.

        Raises:
            ValueError: the file's name does not end in .svg.
            OutputError: it cannot be written.
        """
        path = Path(path)
        if path.suffix != ".svg":
            raise ValueError(f"a picture is saved as .svg, not as {path.suffix or path.name}")
        return write_whole(path, self.svg)

    def _repr_svg_(self) -> str:
        return self.svg

    def __repr__(self) -> str:
        return f"<picture of {len(self.svg)} characters of SVG>"


def overview_svg(run: Run, wanted: Sequence[Chart] | None = None) -> str:
    """A picture of a run, 860 px wide, for light and dark pages.

    Args:
        run: to show.
        wanted: charts in place of the usual ones, without the path.
    """
    charts = _chosen(run) if wanted is None else wanted
    square = _path_square(run) if wanted is None else None
    width = WIDTH - _LEFT - _RIGHT - (0.0 if square is None else _SQUARE + 70)
    times = Times(run.start, run.end, _LEFT, width)
    stages = [times.stage(run.label(v), tints(run)[v.stage], v.start, v.end) for v in run.visits]
    panels = [
        _panel(run, chart, _TOP + i * (_PANEL + _TITLE), times) for i, chart in enumerate(charts)
    ]
    bottom = _TOP + len(panels) * (_PANEL + _TITLE) - _TITLE
    if square is not None:
        bottom = max(bottom, square.y + square.height)
    return template("overview.svg.j2").render(
        width=WIDTH,
        height=bottom + _BOTTOM,
        left=_LEFT,
        top=_TOP,
        inner=width,
        bottom=_TOP + len(panels) * (_PANEL + _TITLE) - _TITLE,
        title=str(run.summary.get("task") or "run"),
        subtitle=_subtitle(run),
        verdict=verdict(run).kind,
        stages=stages,
        faults=[
            times.stage("", 0, each.start, run.end if each.end is None else each.end)
            for each in fault_times(run.summary)
            if each.start is not None
        ],
        panels=panels,
        times=times.marks(8),
        square=square,
    )


def _chosen(run: Run) -> list[Chart]:
    """Force against reference, else all forces; what limits were about; and the position."""
    charts = {chart.key: chart for part in figures.sections(run) for chart in part.charts}
    controlled = [chart for key, chart in charts.items() if key.endswith(".ref")]
    controlled.sort(key=_interest)
    left = charts.get("force_inconsistent")
    if left is not None:
        return [*sorted(controlled, key=lambda chart: chart.key)[:2], left]
    first = controlled[0] if controlled else _borne(charts.get("force"))
    stopped = _at_their_limits(run, charts.get("joint positions"))
    return [c for c in (first, stopped, charts.get("position")) if c is not None]


def _at_their_limits(run: Run, joints: Chart | None) -> Chart | None:
    """A chart of those joints that a program has held at their limits; None without any."""
    given_up = run.summary.get("given_up")
    stages = given_up.values() if isinstance(given_up, dict) else ()
    held = {f"J{j}" for stage in stages for j in held_joints(stage)}
    traces = tuple(t for t in joints.traces if t.label in held) if joints is not None else ()
    return replace(joints, traces=traces) if joints is not None and traces else None


def _interest(chart: Chart) -> tuple[bool, bool, float]:
    """Sorts what an expectation is about first, then forces, then the largest set point."""
    wanted = [t.values for t in chart.traces if t.style == "reference"]
    return not chart.bands, "torque" in chart.key, -size(wanted)


def _borne(forces: Chart | None) -> Chart | None:
    """A chart of all forces without the axes that bear none, and without their size twice."""
    if forces is None:
        return None
    least = _BORNE * max(size([t.values]) for t in forces.traces)
    single = {figures.wrench_name(axis) for axis in figures.LINEAR}
    axes = [t for t in forces.traces if t.signal in single and size([t.values]) >= least]
    if len(axes) != 1:
        return forces
    title = f"Force {axes[0].label}"
    return replace(forces, title=title, traces=(replace(axes[0], label=axes[0].signal),))


def _panel(run: Run, chart: Chart, y: float, times: Times) -> Panel:
    finite = (t.values[np.isfinite(t.values)] for t in chart.traces)
    values = np.array([end(part) for part in finite if len(part) for end in (np.min, np.max)])
    sides = [v for b in chart.bands for v in (b.low, b.high) if v is not None]
    plane = PlotPlane.around(times, values, y, _PANEL, _ROOM, sides)
    lines = []
    for trace in chart.traces:
        gaps = run.breaks[:0] if trace.continuous else run.breaks
        points = plane.points(run.clock, trace.values, run.breaks, gaps)
        name = "" if trace.reference_of else trace.label
        lines.append(Stroke(path_data(points), trace.role, trace.style, name))
    return Panel(
        chart.title.removesuffix(" against its reference"),
        chart.unit,
        _LEFT,
        y,
        times.width,
        _PANEL,
        tuple(lines),
        plane.marks(plane.round(5)),
        tuple(plane.area(band, band.passed) for band in chart.bands),
    )


def _path_square(run: Run) -> Panel | None:
    """The path over x and y of the visit that spans most, to one scale."""
    if any(run.column(f"position.{axis}") is None for axis in "xy"):
        return None
    x, y = 1e3 * run.columns["position.x"], 1e3 * run.columns["position.y"]

    def smaller_span(visit: StageVisit) -> float:
        rows = run.rows(visit)
        return float(min(np.ptp(x[rows]), np.ptp(y[rows]))) if rows.any() else 0.0

    widest = max(run.visits, key=smaller_span, default=None)
    if widest is None or not smaller_span(widest) >= _LEAST_SPAN:
        return None
    rows = run.rows(widest)
    x, y = x[rows], y[rows]
    some = slice(None, None, 1 + len(x) // _PATH_TICKS)
    span = 1.12 * max(float(np.ptp(x)), float(np.ptp(y)))
    low_x = (float(x.min()) + float(x.max()) - span) / 2
    low_y = (float(y.min()) + float(y.max()) - span) / 2
    left, top, scale = WIDTH - _RIGHT - _SQUARE, _TOP, _SQUARE / span

    def drawn(u: Vector, v: Vector) -> str:
        u, v = u[some], v[some]
        points = [left + (u - low_x) * scale, top + _SQUARE - (v - low_y) * scale]
        return path_data(np.column_stack(points))

    lines = [Stroke(drawn(x, y), "z", "line")]
    wanted = [run.column(f"position.{axis}.ref") for axis in "xy"]
    if wanted[0] is not None and wanted[1] is not None:
        d = drawn(1e3 * wanted[0][rows], 1e3 * wanted[1][rows])
        lines.insert(0, Stroke(d, "z", "halo"))
    over, up = ticks(low_x, low_x + span, 4), ticks(low_y, low_y + span, 4)
    return Panel(
        f"Path in {run.label(widest)}, y over x",
        "mm",
        left,
        top,
        _SQUARE,
        _SQUARE,
        tuple(lines),
        tuple(Tick(top + _SQUARE - (v - low_y) * scale, tick_text(v, up)) for v in up),
        columns=tuple(Tick(left + (u - low_x) * scale, tick_text(u, over)) for u in over),
    )


def _subtitle(run: Run) -> str:
    laws = dict.fromkeys(v.law for v in run.visits if v.law)
    parts = [run.robot, ", ".join(laws), f"{run.end:.1f} s"]
    return ", ".join(p for p in parts if p)
