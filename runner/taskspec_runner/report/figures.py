"""The charts of a report: which signals stand together, in which units, against which bounds."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from taskspec_runner.report.data import Expectation, Run, Vector
from taskspec_runner.report.quantities import figure, plain_scale, quantity, scale

LINEAR, ANGULAR = ("x", "y", "z"), ("rx", "ry", "rz")
#: Colour roles of the axes; a rotation has the colour of its axis.
_ROLES = {"x": "x", "y": "y", "z": "z", "rx": "x", "ry": "y", "rz": "z"}


@dataclass(frozen=True, slots=True)
class Trace:
    """One line of a chart.

    Attributes:
        label: in the legend. values: (rows,) in the chart's unit. role: what its colour means.
        style: `line`, `reference` (dashed), `halo` (wide and pale, below the others) or `faint`.
        signal: its name in the log. continuous: whether it runs on through a change of stage.
        reference_of: label of the trace that it is the reference of and shares a legend entry with.
    """

    label: str
    values: Vector
    role: str
    style: str = "line"
    signal: str = ""
    continuous: bool = False
    reference_of: str = ""


@dataclass(frozen=True, slots=True)
class Band:
    """Values that an expectation allows.

    Attributes:
        start, end: run time [s]. low, high: in the chart's unit, None on an open side.
        passed: whether the expectation held. text: the expectation.
    """

    start: float
    end: float
    low: float | None
    high: float | None
    passed: bool
    text: str


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart over run time.

    Attributes:
        key, title, unit, note: as shown. traces, bands: in drawing order.
        limits: levels that must not be passed. always: values that always stay in view.
    """

    key: str
    title: str
    unit: str
    traces: tuple[Trace, ...]
    note: str = ""
    bands: tuple[Band, ...] = ()
    limits: tuple[float, ...] = ()
    always: tuple[float, ...] = ()


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


def sections(run: Run) -> tuple[Section, ...]:
    """The charts of a run, most important first."""
    contact, motion, arm = Section("Contact"), Section("Motion"), Section("Arm")
    for axis in (*LINEAR, *ANGULAR):
        contact.add(_controlled(run, axis))
    contact.add(_wrench(run, "force", LINEAR, "All forces"))
    contact.add(_wrench(run, "torque", ANGULAR, "Moments"))
    contact.add(_gap(run))
    motion.add(_pose(run, LINEAR, "Position"))
    motion.add(_errors(run, LINEAR, "Position error"))
    motion.add(_velocity(run))
    motion.add(_pose(run, ANGULAR, "Orientation"))
    motion.add(_errors(run, ANGULAR, "Orientation error"))
    arm.add(_joint_torques(run))
    arm.add(_joint_positions(run))
    arm.add(_power(run))
    return tuple(s for s in (contact, motion, arm) if s.charts or s.silent)


def wrench_name(axis: str) -> str:
    """`force.z` or `torque.rz`."""
    return f"{'torque' if axis in ANGULAR else 'force'}.{axis}"


def differs(truth: Vector, measured: Vector) -> bool:
    """Whether a measurement is more than the truth one tick late."""
    if len(truth) < 3:
        return False
    spread = float(np.nanmax(truth) - np.nanmin(truth))
    off = np.abs(measured[1:] - truth[:-1]) > 1e-3 * spread + 1e-12
    return bool(np.mean(off) > 0.02)


def _controlled(run: Run, axis: str) -> Chart | None:
    """Force or moment against its reference."""
    name = wrench_name(axis)
    truth, reference = run.column(name), run.column(f"{name}.ref")
    if truth is None or reference is None:
        return None
    factor, unit = scale(run.units[name], _size([truth, reference]))
    traces = []
    measured = run.column(f"{name}.measured")
    if measured is not None and differs(truth, measured):
        label = "measured"
        traces.append(Trace(label, measured * factor, "muted", "faint", f"{name}.measured"))
    traces.append(Trace(name, truth * factor, _ROLES[axis], "line", name))
    traces.append(Trace("reference", reference * factor, "ink", "reference", f"{name}.ref"))
    what = "Moment" if axis in ANGULAR else "Force"
    title = f"{what} {axis} against its reference"
    return Chart(f"{name}.ref", title, unit, tuple(traces), bands=_bands(run, [name], factor))


def _wrench(run: Run, kind: str, axes: Sequence[str], title: str) -> Chart | None:
    found = [(a, c) for a in axes if (c := run.column(wrench_name(a))) is not None]
    if not found:
        return None
    total = np.sqrt(np.sum([c**2 for _, c in found], axis=0))
    names = [wrench_name(a) for a, _ in found]
    factor, unit = scale(run.units[names[0]], _size([total]))
    traces = (
        [Trace(f"|{kind}|", total * factor, "muted", continuous=True)] if len(found) > 1 else []
    )
    for axis, values in found:
        name = wrench_name(axis)
        measured = run.column(f"{name}.measured")
        if measured is not None and differs(values, measured):
            label = f"{axis} measured"
            traces.append(Trace(label, measured * factor, _ROLES[axis], "faint"))
        traces.append(Trace(axis, values * factor, _ROLES[axis], "line", name))
    limit = run.limit(kind)
    limits, note = _limit(limit, factor, run.units[names[0]], _size([total]))
    # The band of an axis with a reference has a chart of its own.
    unbounded = [n for n in names if run.column(f"{n}.ref") is None]
    bands = _bands(run, unbounded, factor)
    return Chart(kind, title, unit, tuple(traces), note, bands, limits)


def _gap(run: Run) -> Chart | None:
    names = [n for n in run.columns if n.endswith(".gap") and run.column(n) is not None]
    if not names and run.column("gap") is not None:
        names = ["gap"]
    if not names:
        return None
    columns = [run.columns[n] for n in names]
    factor, unit = scale("m", _size(columns))
    traces = [
        Trace(n.removesuffix(".gap"), c * factor, f"j{i % 7}", "line", n, True)
        for i, (n, c) in enumerate(zip(names, columns, strict=True))
    ]
    deepest = min(float(np.nanmin(c)) for c in columns)
    note = ""
    if deepest < 0:
        depth, shown = scale("m", deepest)
        note = f"deepest {figure(-deepest * depth)} {shown} inside"
    bands = _bands(run, ["gap", *names], factor)
    return Chart("gap", "Gap to the surface", unit, tuple(traces), note, bands, always=(0.0,))


def _pose(run: Run, axes: Sequence[str], title: str) -> Chart | None:
    names = [f"position.{a}" for a in axes if run.column(f"position.{a}") is not None]
    if not names:
        return None
    factor, unit = plain_scale(run.units[names[0]], 1.0)
    traces = _tracked(run, names, factor)
    note = "counted in the frame of each stage"
    return Chart(title.lower(), title, unit, traces, note, _bands(run, names, factor))


def _errors(run: Run, axes: Sequence[str], title: str) -> Chart | None:
    names = [f"error.{a}" for a in axes if run.column(f"error.{a}") is not None]
    if not names:
        return None
    columns = [run.columns[n] for n in names]
    factor, unit = scale(run.units[names[0]], _size(columns))
    traces = [
        Trace(axis := n.removeprefix("error."), c * factor, _ROLES[axis], "line", n)
        for n, c in zip(names, columns, strict=True)
    ]
    note = "reference − truth, where an axis follows a motion"
    bands = _bands(run, names, factor)
    return Chart(title.lower(), title, unit, tuple(traces), note, bands, always=(0.0,))


def _velocity(run: Run) -> Chart | None:
    names = [f"velocity.{a}" for a in LINEAR if run.column(f"velocity.{a}") is not None]
    speed = run.column("speed")
    columns = [run.columns[n] for n in names] + ([speed] if speed is not None else [])
    if not columns:
        return None
    factor, unit = scale("m/s", _size(columns))
    traces = list(_tracked(run, names, factor))
    if speed is not None:
        traces.append(Trace("speed", speed * factor, "ink", "line", "speed", True))
    limits, note = _limit(run.limit("speed"), factor, "m/s", _size(columns))
    bands = _bands(run, [*names, "speed"], factor)
    return Chart("velocity", "Tool velocity", unit, tuple(traces), note, bands, limits[:1])


def _joint_torques(run: Run) -> Chart | None:
    names = _joints(run, "torque")
    limits = run.summary.get("joint_limits")
    known = limits if isinstance(limits, list) else []
    bounds = [v if isinstance(v, int | float) and 0 < v < np.inf else None for v in known]
    bounds += [None] * (len(names) - len(bounds))
    if not names:
        return None
    if all(b is None for b in bounds):
        factor, unit = scale("N*m", _size([run.columns[n] for n in names]))
        traces = _joint_traces(run, names, [factor] * len(names))
        return Chart("joint torques", "Joint torques", unit, traces)
    bounded = [(n, 100 / b) for n, b in zip(names, bounds, strict=False) if b is not None]
    traces = _joint_traces(run, [n for n, _ in bounded], [f for _, f in bounded])
    peaks = [float(np.nanmax(np.abs(t.values))) for t in traces]
    worst = int(np.argmax(peaks))
    note = f"highest: {traces[worst].label} at {figure(peaks[worst])} % of its limit"
    title = "Joint torques, share of their limits"
    levels = (100.0, -100.0)
    return Chart("joint torques", title, "%", traces, note, limits=levels, always=levels)


def _joint_positions(run: Run) -> Chart | None:
    names = _joints(run, "position")
    if not names:
        return None
    factor, unit = plain_scale(run.units[names[0]], 1.0)
    traces = _joint_traces(run, names, [factor] * len(names))
    return Chart("joint positions", "Joint positions", unit, traces)


def _power(run: Run) -> Chart | None:
    power = run.column("power")
    if power is None:
        return None
    factor, unit = scale("W", _size([power]))
    energy = float(np.nansum(power) * run.period)
    note = f"into the environment; {figure(energy)} J in all"
    traces = (Trace("power", power * factor, "j3", "line", "power", True),)
    return Chart("power", "Power", unit, traces, note, _bands(run, ["power"], factor))


def _tracked(run: Run, names: Sequence[str], factor: float) -> tuple[Trace, ...]:
    """Signals over wide pale lines of their references."""
    traces = []
    for name in names:
        axis = name.rpartition(".")[2]
        reference = run.column(f"{name}.ref")
        if reference is not None:
            values = reference * factor
            traces.append(Trace("ref", values, _ROLES[axis], "halo", f"{name}.ref", False, axis))
    for name in names:
        axis = name.rpartition(".")[2]
        traces.append(Trace(axis, run.columns[name] * factor, _ROLES[axis], "line", name))
    return tuple(traces)


def _joints(run: Run, kind: str) -> list[str]:
    names = [n for n in run.columns if n.startswith("joint.") and n.endswith(f".{kind}")]
    return [n for n in names if run.column(n) is not None]


def _joint_traces(run: Run, names: Sequence[str], factors: Sequence[float]) -> tuple[Trace, ...]:
    traces = []
    for i, (name, factor) in enumerate(zip(names, factors, strict=True)):
        values = run.columns[name] * factor
        traces.append(Trace(f"J{name.split('.')[1]}", values, f"j{i % 7}", "line", name, True))
    return tuple(traces)


def _bands(run: Run, signals: Iterable[str], factor: float) -> tuple[Band, ...]:
    wanted = set(signals)
    return tuple(
        Band(start, end, *_sides(each, factor), each.passed, each.text)
        for each in run.expectations
        if each.band is not None and each.signal in wanted
        for start, end in _windows(run, each)
    )


def _sides(each: Expectation, factor: float) -> tuple[float | None, float | None]:
    low, high = each.band or (None, None)
    return None if low is None else low * factor, None if high is None else high * factor


def _windows(run: Run, each: Expectation) -> list[tuple[float, float]]:
    if each.stage is None:
        return [(float(run.clock[0]), run.end)] if len(run.clock) else []
    return [(v.start, v.end) for v in run.visits if v.stage == each.stage]


def _limit(
    limit: float | None, factor: float, unit: str, peak: float
) -> tuple[tuple[float, ...], str]:
    if limit is None:
        return (), ""
    level = limit * factor
    share = figure(100 * peak / limit, 2) if limit else "–"
    return (level, -level), f"limit {' '.join(quantity(limit, unit))}, peak at {share} % of it"


def _size(columns: Sequence[Vector]) -> float:
    return max(float(np.nanmax(np.abs(c))) for c in columns)
