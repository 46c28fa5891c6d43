"""A picture of a run for a README: force against reference, the motion below, the path beside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from taskspec_runner.pages.chart import Chart, Section, size
from taskspec_runner.pages.picture import Picture, Square, picture_svg
from taskspec_runner.pages.timeline import Timeline
from taskspec_runner.record.visits import StageVisit
from taskspec_runner.report import figures, recorded
from taskspec_runner.report.events import fault_spans
from taskspec_runner.runs import Run
from taskspec_runner.verdict.limit_effects import held_joints
from taskspec_runner.verdict.outcome import is_recorded, verdict

__all__ = ["Picture", "overview_svg"]

#: A path is shown that spans as much in both directions [m].
_LEAST_SPAN = 5e-3
#: Ticks from which on a path is drawn through every second one, and so on.
_PATH_TICKS = 100_000
#: Share of the largest force from which on an axis is worth a line.
_BORNE = 0.05


def overview_svg(
    run: Run,
    wanted: Sequence[Chart] | None = None,
    parts: Sequence[Section] | None = None,
) -> str:
    """A picture of a run, 860 px wide, for light and dark pages.

    Args:
        run: to show.
        wanted: charts in place of the usual ones, without the path.
        parts: sections of its page, where they have been made.
    """
    parts = figures.sections(run) if parts is None and wanted is None else parts
    laws = dict.fromkeys(v.law for v in run.visits if v.law)
    facts = [run.robot, ", ".join(laws)]
    if is_recorded(run):
        facts = ["as measured", *recorded.rates(run)]
    facts.append(f"{run.end:.1f} s")
    return picture_svg(
        str(run.summary.get("task") or "run"),
        ", ".join(fact for fact in facts if fact),
        verdict(run).kind,
        Timeline.of(run),
        _chosen(run, parts or ()) if wanted is None else wanted,
        square=_path(run) if wanted is None else None,
        faults=fault_spans(run),
    )


def _chosen(run: Run, parts: Sequence[Section]) -> list[Chart]:
    """Force against reference, else all forces; what limits were about; settling; the position."""
    charts = {chart.key: chart for part in parts for chart in part.charts}
    controlled = [chart for key, chart in charts.items() if key.endswith(".ref")]
    controlled.sort(key=_interest)
    left = charts.get("force_inconsistent")
    if left is not None:
        return [*sorted(controlled, key=lambda chart: chart.key)[:2], left]
    first = controlled[0] if controlled else _borne(charts.get("force"))
    stopped = _at_their_limits(run, charts.get("joint positions"))
    found = (first, stopped, charts.get("settling"), charts.get("position"))
    return [c for c in found if c is not None]


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


def _path(run: Run) -> Square | None:
    """The path over x and y of the visit that spans most."""
    names = ["position.x", "position.y"]
    if any(run.column(name) is None for name in names):
        return None

    def smaller_span(visit: StageVisit) -> float:
        rows = run.rows(visit)
        if not rows.any():
            return 0.0
        return min(float(np.ptp(run.columns[name][rows])) for name in names)

    widest = max(run.visits, key=smaller_span, default=None)
    if widest is None or not smaller_span(widest) >= _LEAST_SPAN:
        return None
    rows = np.flatnonzero(run.rows(widest))
    rows = rows[:: 1 + len(rows) // _PATH_TICKS]
    lines = []
    for suffix, style in ((".ref", "halo"), ("", "line")):
        if all(run.column(name + suffix) is not None for name in names):
            both = [1e3 * run.columns[name + suffix][rows] for name in names]
            lines.append((np.column_stack(both), style))
    return Square(f"Path in {run.label(widest)}, y over x", "mm", lines)
