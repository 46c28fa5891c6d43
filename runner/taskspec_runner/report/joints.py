"""The charts of the joints, against their limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from taskspec.text.units import MOMENT
from taskspec_runner.report.chart import Chart, Level, Trace, size
from taskspec_runner.report.quantities import figure, plain_scale, scale
from taskspec_runner.runs import Run


def joint_torques(run: Run) -> Chart | None:
    """Torques as shares of their limits, where they have any."""
    names = _joints(run, "torque")
    limits = run.summary.get("joint_limits")
    known = limits if isinstance(limits, list) else []
    bounds = [v if isinstance(v, int | float) and 0 < v < np.inf else None for v in known]
    bounds += [None] * (len(names) - len(bounds))
    if not names:
        return None
    if all(b is None for b in bounds):
        factor, unit = scale(MOMENT, size([run.columns[n] for n in names]))
        traces = _joint_traces(run, names, [factor] * len(names))
        return Chart("joint torques", "Joint torques", unit, traces)
    bounded = [(n, 100 / b) for n, b in zip(names, bounds, strict=False) if b is not None]
    traces = _joint_traces(run, [n for n, _ in bounded], [f for _, f in bounded])
    peaks = [float(np.nanmax(np.abs(t.values))) for t in traces]
    worst = int(np.argmax(peaks))
    note = f"highest: {traces[worst].label} at {figure(peaks[worst])} % of its limit"
    title = "Joint torques, share of their limits"
    full = tuple(Level(run.start, run.end, share) for share in (100.0, -100.0))
    always = tuple(level.value for level in full)
    return Chart("joint torques", title, "%", traces, note, limits=full, always=always)


def joint_positions(run: Run) -> Chart | None:
    """Positions between their limits, or as they are where a joint has none."""
    names = _joints(run, "position")
    if not names:
        return None
    ranges = run.summary.get("joint_ranges")
    found = [_middle(ends) for ends in ranges] if isinstance(ranges, list) else []
    if len(found) != len(names) or None in found:
        factor, unit = plain_scale(run.units[names[0]], 1.0)
        traces = _joint_traces(run, names, [factor] * len(names))
        return Chart("joint positions", "Joint positions", unit, traces)
    middles = [ends for ends in found if ends is not None]
    traces = _joint_traces(
        run, names, [100 / half for _, half in middles], [middle for middle, _ in middles]
    )
    peaks = [float(np.nanmax(np.abs(t.values))) for t in traces]
    worst = int(np.argmax(peaks))
    note = (
        f"0 is the middle, ±100 % a limit; {traces[worst].label} comes to {figure(peaks[worst])} %"
    )
    ends = tuple(Level(run.start, run.end, share) for share in (100.0, -100.0))
    always = tuple(level.value for level in ends)
    title = "Joint positions between their limits"
    return Chart("joint positions", title, "%", traces, note, limits=ends, always=always)


def _middle(ends: object) -> tuple[float, float] | None:
    """Middle and half width of a joint's range; None where it has no end."""
    if not isinstance(ends, list) or len(ends) != 2:
        return None
    low, high = (e if isinstance(e, int | float) else np.nan for e in ends)
    if not np.isfinite(high - low) or high <= low:
        return None
    return (low + high) / 2, (high - low) / 2


def _joints(run: Run, kind: str) -> list[str]:
    names = [n for n in run.columns if n.startswith("joint.") and n.endswith(f".{kind}")]
    return [n for n in names if run.column(n) is not None]


def _joint_traces(
    run: Run,
    names: Sequence[str],
    factors: Sequence[float],
    middles: Sequence[float] | None = None,
) -> tuple[Trace, ...]:
    traces = []
    middles = [0.0] * len(names) if middles is None else middles
    for i, (name, factor, middle) in enumerate(zip(names, factors, middles, strict=True)):
        values = (run.columns[name] - middle) * factor
        traces.append(Trace(f"J{name.split('.')[1]}", values, f"j{i % 7}", "line", name, True))
    return tuple(traces)
