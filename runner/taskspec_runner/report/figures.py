"""The charts of a report: which signals stand together, in which units, against which bounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from taskspec.geometry.axis import AXES, ROTATIONS, TRANSLATIONS
from taskspec.signals import SCALARS
from taskspec.text.units import FORCE, POWER, VELOCITY
from taskspec_runner.record.history import Vector
from taskspec_runner.report.chart import (
    Chart,
    Section,
    Trace,
    bands,
    levels,
    limit_note,
    size,
)
from taskspec_runner.report.expected import JUDGED, with_bounds
from taskspec_runner.report.gaps import gap_charts
from taskspec_runner.report.joints import joint_positions, joint_torques
from taskspec_runner.report.mechanisms import coordinate_charts, effort_charts
from taskspec_runner.report.quantities import plain_scale, quantity, scale
from taskspec_runner.report.rest_levels import rest_levels
from taskspec_runner.report.selection import selected
from taskspec_runner.runs import Run
from taskspec_runner.verdict.metrics import set_points

LINEAR, ANGULAR = TRANSLATIONS, ROTATIONS
#: Colour roles of the axes; a rotation has the colour of its axis.
_ROLES: dict[str, str] = {axis: axis.letter for axis in AXES}


def sections(run: Run) -> tuple[Section, ...]:
    """The charts of a run, most important first."""
    contact, motion, arm = Section("Contact"), Section("Motion"), Section("Arm")
    for axis in (*LINEAR, *ANGULAR):
        contact.add(_controlled(run, wrench_name(axis), axis))
    for number, name in enumerate(set_points(run.columns)):
        contact.add(_controlled(run, name, f"j{number % 7}"))
    for chart in effort_charts(run):
        contact.add(chart)
    contact.add(_inconsistent(run))
    contact.add(_wrench(run, "force", LINEAR, "All forces"))
    contact.add(_wrench(run, "torque", ANGULAR, "Moments"))
    for chart in gap_charts(run):
        contact.add(chart)
    for chart in coordinate_charts(run):
        motion.add(chart)
    motion.add(_pose(run, LINEAR, "Position"))
    motion.add(_errors(run, LINEAR, "Position error"))
    motion.add(_velocity(run))
    motion.add(_pose(run, ANGULAR, "Orientation"))
    motion.add(_errors(run, ANGULAR, "Orientation error"))
    arm.add(joint_torques(run))
    arm.add(joint_positions(run))
    arm.add(_power(run))
    drawn = (contact, motion, arm)
    shown = with_bounds(run, (*drawn, _judged(run, drawn)))
    return tuple(s for s in shown if s.charts or s.silent)


def _judged(run: Run, drawn: Sequence[Section]) -> Section:
    """Single signals that expectations bound and that no other chart shows."""
    shown = {t.signal for section in drawn for chart in section.charts for t in chart.traces}
    numbers = [name for name, signal in SCALARS.items() if not signal.condition]
    bounded = {expectation.signal for expectation in run.expectations}
    names = [n for n in numbers if n in bounded - shown and run.column(n) is not None]
    section = Section(JUDGED)
    for chart in selected(run, names):
        title = ", ".join(trace.label for trace in chart.traces)
        section.add(replace(chart, title=title[:1].upper() + title[1:]))
    return section


def wrench_name(axis: str) -> str:
    """`force.z` or `torque.rz`."""
    return f"{'torque' if axis in ANGULAR else 'force'}.{axis}"


def differs(truth: Vector, measured: Vector, spread: float) -> bool:
    """Whether a measurement is more than the truth one tick late, seen against a spread."""
    off = np.abs(measured[1:] - truth[:-1]) > 1e-3 * spread
    return len(off) > 0 and bool(np.mean(off) > 0.02)


def _controlled(run: Run, name: str, on: str) -> Chart | None:
    """Force or moment against its reference, on an axis or along an equation's normal."""
    truth, reference = run.column(name), run.column(f"{name}.ref")
    if truth is None or reference is None:
        return None
    factor, unit = scale(run.units[name], size([truth, reference]))
    traces = []
    measured = run.column(f"{name}.measured")
    if measured is not None and differs(truth, measured, size([truth])):
        label = "measured"
        traces.append(Trace(label, measured * factor, "muted", "faint", f"{name}.measured"))
    traces.append(Trace(name, truth * factor, _ROLES.get(on, on), "line", name))
    traces.append(Trace("reference", reference * factor, "ink", "reference", f"{name}.ref"))
    what = "Moment" if "torque" in name else "Force"
    where = on if on in _ROLES else f"of {name.partition('.')[0]}"
    title = f"{what} {where} against its reference"
    levels_ = tuple(rest_levels(run, [name], factor))
    return Chart(
        f"{name}.ref", title, unit, tuple(traces), bands=bands(run, [name], factor),
        limits=levels_, factor=factor,
    )  # fmt: skip


def _wrench(run: Run, kind: str, axes: Sequence[str], title: str) -> Chart | None:
    found = [(a, c) for a in axes if (c := run.column(wrench_name(a))) is not None]
    if not found:
        return None
    total = np.sqrt(reduce(np.add, (np.where(np.isnan(c), 0.0, c**2) for _, c in found)))
    names = [wrench_name(a) for a, _ in found]
    whole = f"norm({', '.join(map(wrench_name, axes))})"
    factor, unit = scale(run.units[names[0]], size([total]))
    traces = (
        [Trace(f"|{kind}|", total * factor, "muted", signal=whole, continuous=True)]
        if len(found) > 1
        else []
    )
    for axis, values in found:
        name = wrench_name(axis)
        measured = run.column(f"{name}.measured")
        if measured is not None and differs(values, measured, size([total])):
            label = f"{axis} measured"
            traces.append(Trace(label, measured * factor, _ROLES[axis], "faint"))
        traces.append(Trace(axis, values * factor, _ROLES[axis], "line", name))
    note = limit_note(run, kind, run.units[names[0]], size([total]))
    # The band of an axis with a reference has a chart of its own.
    unbounded = [n for n in names if run.column(f"{n}.ref") is None]
    limits = (
        *levels(run, kind, factor, (1, -1)),
        *rest_levels(run, unbounded, factor),
    )
    bounds = bands(run, unbounded, factor)
    return Chart(kind, title, unit, tuple(traces), note, bounds, limits, factor=factor)


def _inconsistent(run: Run) -> Chart | None:
    """What of the force set points contacts cannot return, where there is any."""
    left = run.column("force_inconsistent")
    if left is None or not np.any(left > 0):
        return None
    factor, unit = scale(FORCE, size([left]))
    trace = Trace("set points - nearest", left * factor, "ink", "line", "force_inconsistent")
    title, note = "Beyond what contacts return", "set points minus the nearest forces that they can"
    return Chart("force_inconsistent", title, unit, (trace,), note, always=(0.0,), factor=factor)


def _pose(run: Run, axes: Sequence[str], title: str) -> Chart | None:
    names = [f"position.{a}" for a in axes if run.column(f"position.{a}") is not None]
    if not names:
        return None
    factor, unit = plain_scale(run.units[names[0]], 1.0)
    traces = _tracked(run, names, factor)
    note = "counted in the frame of each stage"
    bounds = bands(run, names, factor)
    return Chart(title.lower(), title, unit, traces, note, bounds, factor=factor)


def _errors(run: Run, axes: Sequence[str], title: str) -> Chart | None:
    names = [f"error.{a}" for a in axes if run.column(f"error.{a}") is not None]
    if not names:
        return None
    columns = [run.columns[n] for n in names]
    factor, unit = scale(run.units[names[0]], size(columns))
    traces = [
        Trace(axis := n.removeprefix("error."), c * factor, _ROLES[axis], "line", n)
        for n, c in zip(names, columns, strict=True)
    ]
    note = "reference − truth, where an axis follows a motion"
    bounds = bands(run, names, factor)
    return Chart(
        title.lower(), title, unit, tuple(traces), note, bounds, always=(0.0,), factor=factor
    )


def _velocity(run: Run) -> Chart | None:
    names = [f"velocity.{a}" for a in LINEAR if run.column(f"velocity.{a}") is not None]
    speed = run.column("speed")
    columns = [run.columns[n] for n in names] + ([speed] if speed is not None else [])
    if not columns:
        return None
    factor, unit = scale(VELOCITY, size(columns))
    traces = list(_tracked(run, names, factor))
    if speed is not None:
        traces.append(Trace("speed", speed * factor, "ink", "line", "speed", True))
    note = limit_note(run, "speed", "m/s", size(columns))
    bounds = bands(run, [*names, "speed"], factor)
    limits = levels(run, "speed", factor, (1,))
    return Chart(
        "velocity", "Tool velocity", unit, tuple(traces), note, bounds, limits, factor=factor
    )


def _power(run: Run) -> Chart | None:
    power = run.column("power")
    if power is None:
        return None
    factor, unit = scale(POWER, size([power]))
    energy = float(np.nansum(power) * run.period)
    note = f"into the environment; {' '.join(quantity(energy, 'J'))} in all"
    traces = (Trace("power", power * factor, "j3", "line", "power", True),)
    bounds = bands(run, ["power"], factor)
    return Chart("power", "Power", unit, traces, note, bounds, factor=factor)


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
