"""The charts of a report: which signals stand together, in which units, against which bounds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import reduce

import numpy as np

from taskspec.geometry.axis import AXES, ROTATIONS, TRANSLATIONS
from taskspec.signals import SCALARS
from taskspec.spec.servo import TORQUE, VELOCITY
from taskspec.text.units import LENGTH
from taskspec_runner.pages.chart import (
    Chart,
    Drawn,
    Level,
    Section,
    Trace,
    bands,
    law_levels,
    levels,
    limit_note,
    of_signals,
    size,
)
from taskspec_runner.pages.numbers import figure, quantity, scale
from taskspec_runner.record.history import Vector, commanded
from taskspec_runner.report.expected import JUDGED, with_bounds
from taskspec_runner.report.rest_levels import rest_levels
from taskspec_runner.report.selection import selected
from taskspec_runner.report.settling import settlings
from taskspec_runner.runs import Run
from taskspec_runner.verdict import velocity
from taskspec_runner.verdict.energy import MOST
from taskspec_runner.verdict.metrics import set_points

LINEAR, ANGULAR = TRANSLATIONS, ROTATIONS
#: Colour roles of the axes; a rotation has the colour of its axis.
_ROLES: dict[str, str] = {axis: axis.letter for axis in AXES}
_GAP = ".gap"
#: A share of the most at which a line is invisible beside the others.
_SEEN = 1e-3
#: Deviations below are rounding [m].
_ROUNDING = 1e-9


def sections(run: Run) -> tuple[Section, ...]:
    """The charts of a run, most important first."""
    contact, motion, arm = Section("Contact"), Section("Motion"), Section("Arm")
    energy = Section("Energy")
    for axis in (*LINEAR, *ANGULAR):
        contact.add(_controlled(run, wrench_name(axis), axis))
    for number, name in enumerate(set_points(run.columns)):
        contact.add(_controlled(run, name, f"j{number % 7}"))
    contact.add(_mechanisms(run, "torque", "Moment on the mechanism, about its axis"))
    contact.add(_mechanisms(run, "force", "Force on the mechanism, along its axis"))
    contact.add(_settling(run))
    contact.add(_estimates(run))
    for chart in _grip(run):
        contact.add(chart)
    contact.add(_inconsistent(run))
    contact.add(_wrench(run, "force", LINEAR, "All forces"))
    contact.add(_wrench(run, "torque", ANGULAR, "Moments"))
    for chart in _gaps(run):
        contact.add(chart)
    contact.add(_residuals(run))
    motion.add(_mechanisms(run, "angle", "Angle", places=True))
    motion.add(_mechanisms(run, "travel", "Travel along the axis", places=True))
    motion.add(_pose(run, LINEAR, "Position"))
    motion.add(_errors(run, LINEAR, "Position error"))
    motion.add(_velocity(run))
    if not _upright(run):
        motion.add(_pose(run, ANGULAR, "Orientation"))
    motion.add(_errors(run, ANGULAR, "Orientation error"))
    for chart in _on_joints(run):
        motion.add(chart)
    arm.add(_joint_commands(run))
    arm.add(_joint_torques(run))
    arm.add(_disturbances(run))
    arm.add(_compensated(run))
    for chart in _estimated_velocities(run):
        arm.add(chart)
    arm.add(_joint_positions(run))
    arm.add(_power(run))
    for chart in _payload(run):
        arm.add(chart)
    for chart in _energies(run):
        energy.add(chart)
    drawn = (contact, motion, arm, energy)
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
    measured = run.column(f"{name}.measured")
    shown = measured is not None and differs(truth, measured, size([truth]))
    what = "Moment" if "torque" in name else "Force"
    where = on if on in _ROLES else f"of {name.partition('.')[0]}"
    chart = of_signals(
        run,
        f"{name}.ref",
        f"{what} {where} against its reference",
        [
            *([Drawn(f"{name}.measured", "muted", "measured", "faint")] if shown else ()),
            Drawn(name, _ROLES.get(on, on)),
            Drawn(f"{name}.ref", "ink", "reference", "reference"),
        ],
    )
    return chart and replace(chart, levels=tuple(rest_levels(run, [name], chart.factor)))


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
    bounds = bands(run, unbounded, factor)
    limits = (*levels(run, kind, factor, (1, -1)), *rest_levels(run, unbounded, factor))
    return Chart(kind, title, unit, tuple(traces), note, bounds, limits, factor=factor)


def _settling(run: Run) -> Chart | None:
    """The deviation of presses under the PID regulator, below the bound of Theorem 4.1."""
    error, bound = np.full((2, len(run)), np.nan)
    said = []
    for each in settlings(run):
        error[each.rows] = np.where(each.error > _ROUNDING, each.error, np.nan)
        said.append(each.text)
        if each.bound is not None:
            bound[each.rows] = each.bound.at(run.period * np.arange(len(each.error), dtype=float))
    columns = [column for column in (error, bound) if np.isfinite(column).any()]
    if not columns:
        return None
    factor, unit = scale("m", size(columns))
    traces = [Trace("||e||", factor * error, "ink")]
    if len(columns) == 2:
        traces.append(Trace("bound", factor * bound, "muted", "reference"))
    title = "Deviation from the equilibrium, and the bound of Theorem 4.1"
    return Chart("settling", title, unit, tuple(traces), "; ".join(said), log=True)


def _inconsistent(run: Run) -> Chart | None:
    """What of the force set points contacts cannot return, where there is any."""
    left = run.column("force_inconsistent")
    if left is None or not np.any(left > 0):
        return None
    line = Drawn("force_inconsistent", "ink", "set points - nearest")
    title, note = "Beyond what contacts return", "set points minus the nearest forces that they can"
    return of_signals(run, "force_inconsistent", title, [line], note, always=(0.0,))


def _gaps(run: Run) -> Iterator[Chart | None]:
    """Distances from surfaces and equations, and of the joints from equations on them."""
    names = [n for n in run.columns if n.endswith(_GAP) and run.column(n) is not None]
    names = names or ["gap"]
    on_joints = [n for n in names if run.units.get(n) == "rad"]
    yield _gap(run, "gap", [n for n in names if n not in on_joints])
    yield _gap(run, "gap of joints", on_joints)


def _gap(run: Run, key: str, names: Sequence[str]) -> Chart | None:
    # Off an equation is off it to either side; below a surface is inside.
    equations = {name.partition(".")[0] for name in set_points(run.columns)}
    surfaces = [n for n in names if n.removesuffix(_GAP) not in equations]
    columns = [run.columns[n] for n in surfaces if run.column(n) is not None]
    deepest = min((float(np.nanmin(c)) for c in columns), default=0.0)
    lines = [
        Drawn(n, f"j{i % 7}", n.removesuffix(_GAP), continuous=True) for i, n in enumerate(names)
    ]
    # Where the joints' references are off an equation, which of them yields is the constraint's.
    planned = [(n, i) for i, n in enumerate(names) if run.column(f"{n}.ref") is not None]
    lines += [Drawn(f"{n}.ref", f"j{i % 7}", "of q_d", "reference") for n, i in planned]
    chart = of_signals(
        run,
        key,
        "Gap to the surface" if surfaces else "Distance from the constraints",
        lines,
        f"deepest {' '.join(quantity(-deepest, LENGTH))} inside" if deepest < 0 else "",
        always=(0.0,),
    )
    if chart is None:
        return None
    near = bands(run, ["gap", *names] if "gap" not in names else names, chart.factor)
    return replace(chart, bands=near)


def _residuals(run: Run) -> Chart | None:
    """What constraints cannot make of set points that are given as joint torques."""
    names = [n for n in run.columns if n.endswith(".residual") and run.column(n) is not None]
    lines = [
        Drawn(n, f"j{i % 7}", n.removesuffix(".residual"), continuous=True)
        for i, n in enumerate(names)
    ]
    title, note = "Joint torques that no force makes", "length of u_phi,d - J_phi^T lambda_d"
    return of_signals(run, "residual of constraints", title, lines, note, always=(0.0,))


def _on_joints(run: Run) -> Iterator[Chart | None]:
    """Joints on their path: against their references, and the greatest error."""
    names = [n for n in run.columns if n.startswith("joint.") and n.endswith(".position")]
    names = [n for n in names if run.column(f"{n}.ref") is not None]
    if not names:
        return
    labels = {n: f"J{n.split('.')[1]}" for n in names}
    lines = [
        Drawn(f"{n}.ref", f"j{i % 7}", "ref", "halo", reference_of=labels[n])
        for i, n in enumerate(names)
    ]
    lines += [Drawn(n, f"j{i % 7}", labels[n]) for i, n in enumerate(names)]
    title = "Joints against their references"
    yield of_signals(run, "joint path", title, lines, places=True)
    error, note = [Drawn("joint_error", "ink")], "of the joint farthest from its reference"
    yield of_signals(run, "joint error", "Joint error", error, note, always=(0.0,))


def _mechanisms(run: Run, signal: str, title: str, *, places: bool = False) -> Chart | None:
    """A signal of the objects that have a coordinate of their own."""
    owners = (name.rpartition(".") for name in run.columns)
    found = dict.fromkeys(o for o, _, last in owners if o and last in ("angle", "travel"))
    names = [n for o in found if run.column(n := f"{o}.{signal}") is not None]
    lines = [Drawn(name, f"j{i % 7}", continuous=True) for i, name in enumerate(names)]
    return of_signals(run, f"mechanism {signal}", title, lines, places=places)


def _pose(run: Run, axes: Sequence[str], title: str) -> Chart | None:
    note = "counted in the frame of each stage"
    lines = _tracked(run, [f"position.{axis}" for axis in axes])
    return of_signals(run, title.lower(), title, lines, note, places=True)


def _upright(run: Run) -> bool:
    """Whether all orientations are held at zero, so that they are their errors the other way up."""
    held = [f"position.{axis}" for axis in ANGULAR if run.column(f"position.{axis}") is not None]
    references = [run.column(f"{name}.ref") for name in held]
    known = [r for r in references if r is not None and not np.isnan(r).any()]
    return bool(held) and len(known) == len(held) and max(map(np.ptp, known)) == 0 == size(known)


def _errors(run: Run, axes: Sequence[str], title: str) -> Chart | None:
    note = "reference − truth, where an axis follows a motion"
    lines = [Drawn(f"error.{axis}", _ROLES[axis], axis) for axis in axes]
    chart = of_signals(run, title.lower(), title, lines, note, always=(0.0,))
    if chart is None:
        return None
    # One for all axes as a rule: the layer of a law is, and so is the slope of its loops.
    bounds = dict.fromkeys(
        level
        for axis in axes
        for level in law_levels(run, f"error.{axis}", chart.factor, "bound of the layer", (1, -1))
    )
    return replace(chart, levels=(*chart.levels, *bounds))


def _velocity(run: Run) -> Chart | None:
    lines = _tracked(run, [f"velocity.{axis}" for axis in LINEAR])
    lines.append(Drawn("speed", "ink", continuous=True))
    chart = of_signals(run, "velocity", "Tool velocity", lines)
    if chart is None:
        return None
    peak = size([trace.values for trace in chart.traces if trace.style == "line"]) / chart.factor
    return replace(
        chart,
        note=limit_note(run, "speed", "m/s", peak),
        levels=levels(run, "speed", chart.factor, (1,)),
    )


def _power(run: Run) -> Chart | None:
    power = run.column("power")
    energy = 0.0 if power is None else float(np.nansum(power) * run.period)
    note = f"into the environment; {' '.join(quantity(energy, 'J'))} in all"
    return of_signals(run, "power", "Power", [Drawn("power", "j3", continuous=True)], note)


def _disturbances(run: Run) -> Chart | None:
    """What moves the arm beside its torques and the measured wrench."""
    chart = _joints(run, "disturbance", (), "", "")
    title, note = "Disturbances of the joints", "as the observer estimates them, and takes them off"
    return chart and replace(chart, title=title, note=note)


def _payload(run: Run) -> Iterator[Chart | None]:
    """The payload that laws adapt to."""
    note = "as the controller has it"
    mass = [Drawn("payload.mass", "ink", continuous=True)]
    yield of_signals(run, "payload", "Mass of the payload", mass, note, always=(0.0,))
    centre = [Drawn(f"payload.{axis}", axis, axis, continuous=True) for axis in "xyz"]
    title, note = "Centre of the payload", "from the tip, in the tool's axes"
    yield of_signals(run, "payload centre", title, centre, note, always=(0.0,))


def _grip(run: Run) -> Iterator[Chart | None]:
    """What the jaws press with, and how far what they hold has slid."""
    lines = [
        Drawn("grip.command", "ink", "commanded", "reference"),
        Drawn("grip.force", "z", "of each jaw"),
    ]
    title, note = "Force of the gripper", "dashed: as commanded; 0 opens it"
    yield of_signals(run, "grip force", title, lines, note, always=(0.0,))
    slid = [Drawn("grip.slip", "x", continuous=True)]
    title, note = "Slip in the gripper", "since the command last changed"
    yield of_signals(run, "grip slip", title, slid, note, always=(0.0,))


def _estimates(run: Run) -> Chart | None:
    """The stiffness that is estimated along each axis, and that which gains are those for."""
    lines = [
        Drawn(f"estimate.{name}.{axis}", _ROLES[axis], f"{axis}{said}", style)
        for axis in LINEAR
        for name, style, said in (("stiffness", "line", ""), ("followed", "reference", ", gains"))
    ]
    note = "dashed: what designed gains are those for"
    title = "Estimated stiffness of the contact"
    chart = of_signals(run, "estimate.stiffness", title, lines, note)
    # Ten times softer and ten times stiffer are to be read alike.
    return chart and replace(chart, log=True)


#: The energies of a law, and the terms that change what it stores, with their colours.
_STORED = {"energy.lyapunov": "ink", "energy.kinetic": "x", "energy.spring": "y",
           "energy.contact": "z"}  # fmt: skip
_TERMS = {"contact": "j0", "reference": "j1", "force": "j2", "integral": "j3", "gains": "j4",
          "torques": "j5", "sampling": "j6", "tank": "x", "rest": "muted",
          "dissipated": "ink"}  # fmt: skip


_TOGETHER = "together"


def _energies(run: Run) -> Iterator[Chart | None]:
    """What laws store, and what has changed that since each stage began."""
    found = run.energies if not run.manifest.get("recorded") and len(run) <= MOST else None
    if found is None or not found.visits:
        return
    stored = {name: found.column(name) for name in ("energy.stored", *_STORED)}
    lines = [(n, v, _STORED.get(n, "muted")) for n, v in stored.items() if np.isfinite(v).any()]
    said = ", ".join(dict.fromkeys(each.storage for each in found.visits))
    yield _of_energy(run, "energy", "Energy of the laws", lines, said)
    works = {name: found.work(name) for name in _TERMS}
    works["dissipated"] = -works["dissipated"]
    most = size([stored["energy.stored"], *works.values()])
    lines = [(n, v, _TERMS[n]) for n, v in works.items() if size([v]) > _SEEN * most]
    lines.append((_TOGETHER, reduce(np.add, works.values()), "ink"))
    note = "work since each stage began; dissipated is taken out, and together they are stored"
    yield _of_energy(run, "work", "What changes the stored energy", lines, note)
    if run.column("tank.energy") is not None:
        yield _tank(run)
        yield _let_through(run)
        power = [Drawn("tank.power", "j3", "out of it", continuous=True)]
        chart = of_signals(run, "tank power", "Power out of the energy tank", power)
        if chart is not None:
            bounds = law_levels(run, "tank.power", chart.factor, "most that leaves it")
            chart = replace(chart, levels=bounds)
        yield chart


def _let_through(run: Run) -> Chart | None:
    """The shares of springs and of all other terms that energy tanks let through."""
    lines = (("tank.spring", "springs", "z"), ("tank.share", "other terms", "x"))
    traces = tuple(
        Trace(label, 100 * run.columns[name], role, "line", name, True)
        for name, label, role in lines
        if run.column(name) is not None
    )
    if not traces:
        return None
    note = "of what the law commands; 100 % is the law itself"
    title = "What the energy tank lets through"
    return Chart("tank shares", title, "%", traces, note, always=(0.0, 100.0), factor=100.0)


def _tank(run: Run) -> Chart:
    """What is in energy tanks, and what they hold at most."""
    energy, power = run.column("tank.energy"), run.column("tank.power")
    refused = run.column("tank.refused")
    assert energy is not None
    lines = [("tank.energy", energy, "z")]
    share = 0.0 if refused is None else float(np.nanmax(refused, initial=0.0))
    most = 0.0 if power is None else float(np.nanmax(power, initial=0.0))
    note = f"at most {' '.join(quantity(most, 'W'))} left it, and {100 * share:.3g} % was refused"
    chart = _of_energy(run, "tank", "In the energy tank", lines, note)
    return replace(chart, levels=law_levels(run, "tank.energy", chart.factor, "capacity"))


def _of_energy(
    run: Run, key: str, title: str, lines: Sequence[tuple[str, Vector, str]], note: str
) -> Chart:
    factor, unit = scale("J", size([values for _, values, _ in lines]))
    traces = tuple(
        Trace(
            name.removeprefix("energy."),
            values * factor,
            role,
            "reference" if name == _TOGETHER else "line",
            name,
        )
        for name, values, role in lines
    )
    bounds = bands(run, [name for name, *_ in lines], factor)
    return Chart(key, title, unit, traces, note, bounds, always=(0.0,), factor=factor)


def _tracked(run: Run, names: Sequence[str]) -> list[Drawn]:
    """Signals over wide pale lines of their references."""
    named = [(n, n.rpartition(".")[2]) for n in names if run.column(n) is not None]
    wide = [Drawn(f"{n}.ref", _ROLES[axis], "ref", "halo", reference_of=axis) for n, axis in named]
    return [*wide, *(Drawn(n, _ROLES[axis], axis) for n, axis in named)]


def _joint_torques(run: Run) -> Chart | None:
    """Torques as shares of their limits, where they have any."""
    of = "Joint torques" if commanded(run.columns) == TORQUE else "Torques that the servo exerts"
    bounds = _limits(run, "joint_limits")
    return _joints(run, "torque", bounds, f"{of}, share of their limits", _HIGHEST)


def _compensated(run: Run) -> Chart | None:
    """What of the joint torques is there against friction."""
    names = _of_joints(run, "torque.friction")
    lines = [Drawn(n, f"j{i % 7}", _label(n)) for i, n in enumerate(names)]
    title, note = "Compensated friction of the joints", "part of the joint torques above"
    return of_signals(run, "compensated friction", title, lines, note, always=(0.0,))


def _estimated_velocities(run: Run) -> Iterator[Chart | None]:
    """Velocities that the controller has estimated: over the true ones, and what they lack."""
    names = [n.removesuffix(".measured") for n in _of_joints(run, "velocity.measured")]
    names = [n for n in names if run.column(n) is not None]
    if "velocity" not in run.summary or not names:
        return
    roles = {n: f"j{i % 7}" for i, n in enumerate(names)}
    lines = [Drawn(f"{n}.measured", roles[n], f"{_label(n)} estimated", "faint") for n in names]
    lines += [Drawn(n, roles[n], _label(n)) for n in names]
    title, note = "Joint velocities, and their estimates", "pale: as the controller has them"
    yield of_signals(run, "estimated velocities", title, lines, note, always=(0.0,))
    errors = [run.columns[f"{n}.measured"] - run.columns[n] for n in names]
    factor, unit = scale(run.units[names[0]], size(errors))
    traces = tuple(
        Trace(_label(n), error * factor, roles[n]) for n, error in zip(names, errors, strict=True)
    )
    said = "; ".join(velocity.sentences(run.summary))
    yield Chart(
        "velocity errors", "Estimated minus true joint velocities", unit, traces, said,
        always=(0.0,), factor=factor,
    )  # fmt: skip


def _label(name: str) -> str:
    """`J2` of a signal of joint 2."""
    return f"J{name.split('.')[1]}"


def _of_joints(run: Run, kind: str) -> list[str]:
    """The columns of a signal of joints that have a value, in one unit."""
    names = [n for n in run.columns if n.startswith("joint.") and n.endswith(f".{kind}")]
    names = [n for n in names if run.column(n) is not None]
    return [n for n in names if run.units[n] == run.units[names[0]]]


def _joint_commands(run: Run) -> Chart | None:
    """What an arm is commanded that takes no torques: velocities, or how far ahead positions are.

    Such a position is ahead of its joint by what the servo is late, and gives way under load.
    """
    kind = commanded(run.columns)
    if kind == TORQUE:
        return None
    names = [n for n in run.columns if n.startswith("joint.") and n.endswith(f".{kind}.command")]
    if kind == VELOCITY:
        return _joint_velocities(run, names)
    ahead = [run.columns[n] - run.columns[n.removesuffix(".command")] for n in names]
    units = {run.units[n] for n in names}
    if len(units) > 1:
        lines = [Drawn(n, f"j{i % 7}", n.split(".")[1]) for i, n in enumerate(names)]
        return of_signals(run, "joint commands", "Commanded joint positions", lines, places=True)
    factor, unit = scale(units.pop(), size(ahead))
    traces = tuple(
        Trace(f"J{n.split('.')[1]}", values * factor, f"j{i % 7}", "line", n, True)
        for i, (n, values) in enumerate(zip(names, ahead, strict=True))
    )
    title, note = "Commanded joint positions, ahead of the joints", "commanded − measured"
    return Chart("joint commands", title, unit, traces, note, always=(0.0,))


def _joint_velocities(run: Run, names: Sequence[str]) -> Chart | None:
    """Velocities that are commanded, of which the limits are far away as a rule."""
    labels = [f"J{n.split('.')[1]}" for n in names]
    lines = [
        Drawn(n, f"j{i % 7}", label) for i, (n, label) in enumerate(zip(names, labels, strict=True))
    ]
    limits = zip(labels, names, _limits(run, "command_limits"), strict=False)
    shares = [(size([run.columns[n]]) / most[1], label) for label, n, most in limits if most]
    said = _HIGHEST.format(max(shares)[1], figure(100 * max(shares)[0])) if shares else ""
    return of_signals(
        run, "joint commands", "Commanded joint velocities", lines, said, always=(0.0,)
    )


_HIGHEST = "highest: {} at {} % of its limit"


def _limits(run: Run, key: str) -> list[tuple[float, float] | None]:
    """Middle and half width of what joints can do either way, from a run's summary."""
    limits = run.summary.get(key)
    known = limits if isinstance(limits, list) else []
    return [(0.0, v) if isinstance(v, int | float) and 0 < v < np.inf else None for v in known]


def _joint_positions(run: Run) -> Chart | None:
    """Positions between their limits, or as they are where a joint has none."""
    ranges = run.summary.get("joint_ranges")
    found = [_middle(ends) for ends in ranges] if isinstance(ranges, list) else []
    note = "0 is the middle, ±100 % a limit; {} comes to {} %"
    bounds = [] if None in found else found
    return _joints(run, "position", bounds, "Joint positions between their limits", note)


def _joints(
    run: Run, kind: str, bounds: Sequence[tuple[float, float] | None], title: str, note: str
) -> Chart | None:
    """A signal of the joints that have bounds, as a share of these; of all if none has any.

    Args:
        run: that it is of.
        kind: of the signal.
        bounds: middle and half width [SI] of each joint.
        title: where there are bounds.
        note: takes the joint that comes nearest to its bound, and how near.
    """
    names = [n for n in run.columns if n.startswith("joint.") and n.endswith(f".{kind}")]
    names = [n for n in names if run.column(n) is not None]
    key, labels = f"joint {kind}s", {n: f"J{n.split('.')[1]}" for n in names}
    bounded = [(n, b) for n, b in zip(names, bounds, strict=False) if b is not None]
    if not bounded:
        lines = [Drawn(n, f"j{i % 7}", labels[n], continuous=True) for i, n in enumerate(names)]
        return of_signals(run, key, key.capitalize(), lines, places=kind == "position")
    traces = tuple(
        Trace(labels[n], (run.columns[n] - middle) * (100 / half), f"j{i % 7}", "line", n, True)
        for i, (n, (middle, half)) in enumerate(bounded)
    )
    worst = max(traces, key=lambda trace: size([trace.values]))
    said = note.format(worst.label, figure(size([worst.values])))
    ends = (100.0, -100.0)
    full = tuple(Level(run.start, run.end, share) for share in ends)
    return Chart(key, title, "%", traces, said, levels=full, always=ends)


def _middle(ends: object) -> tuple[float, float] | None:
    """Middle and half width of a joint's range; None where it has no end."""
    if not isinstance(ends, list) or len(ends) != 2:
        return None
    low, high = (e if isinstance(e, int | float) else np.nan for e in ends)
    if not np.isfinite(high - low) or high <= low:
        return None
    return (low + high) / 2, (high - low) / 2
