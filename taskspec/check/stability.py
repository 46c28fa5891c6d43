"""Stages whose sampled closed loop is predicted to be unstable, or to ring."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np

from taskspec.analysis.corners import Corner, at, corners
from taskspec.analysis.loop import Mode, UnfitError
from taskspec.analysis.margin import (
    LEAST_DAMPING_RATIO,
    PROPOSED,
    Limit,
    Search,
    grows,
    quiet,
    rings,
    stable,
)
from taskspec.analysis.stage import Analysed, analyse
from taskspec.program.context import Context
from taskspec.program.stiffness import RESOLVED_PHASE
from taskspec.spec import Axis, Stage, Task
from taskspec.text.diagnostic import Diagnostics, Severity
from taskspec.text.show import number, show
from taskspec.text.source import Span

#: No more ways to mend a stage are proposed than these of its gains.
_MOST_PROPOSED = 2
#: A varied value is left out of a message if without it a mode grows, or is damped, as much.
_AS_MUCH = 0.95

#: Gain -> units on a translation and on a rotation.
_UNITS = {
    "force.integral": ("1/s", "1/s"),
    "force.proportional": ("", ""),
    "force.damping": ("N*s/m", "N*m*s/rad"),
    "damping": ("N*s/m", "N*m*s/rad"),
    "mass": ("kg", "kg*m^2"),
    "stiffness": ("N/m", "N*m/rad"),
    "bandwidth": ("Hz", "Hz"),
    "joint_damping": ("N*m*s/rad", "N*m*s/rad"),
}


def check_stability(context: Context, found: Diagnostics) -> None:
    """Reports stages that are predicted to be unstable or to ring, each way of control once."""
    seen: set[str] = set()
    for name, stage in context.loaded.task.stages.items():
        key = _control(context, stage)
        if key in seen:
            continue
        seen.add(key)
        try:
            _check_stage(context, name, found)
        except (UnfitError, np.linalg.LinAlgError):
            continue


def _control(context: Context, stage: Stage) -> str:
    """What the stability of a stage depends on: stages that have it in common need one look."""
    axes = {name: _kind(axis) for name, axis in stage.axes.items() if _kind(axis) != _kind(Axis())}
    frame = context.frame_of(stage).name
    law = context.law_of(stage).model_dump_json()
    return repr((sorted(axes.items()), frame, law, sorted(stage.constraints)))


def _kind(axis: Axis) -> tuple[object, ...]:
    return (
        axis.force is not None,
        axis.torque is not None,
        axis.hold == "world",
        axis.follows,
        axis.stiffness,
        axis.damping,
    )


def _check_stage(context: Context, name: str, found: Diagnostics) -> None:
    seen = analyse(context, name)
    if seen is None or not _resolved(seen, context.loaded.task):
        return
    if seen.meets:
        free = seen.free()
        if not _check_nominal(context, free, found):
            return
        worst = _worst(seen.modes())
        if worst is not None and grows(worst):
            _report(
                context, seen, worst, found, "TS505", Severity.WARNING,
                f"stage {name!r} would be unstable in contact with {next(iter(seen.pressed))!r}",
            )  # fmt: skip
        return
    if _check_nominal(context, seen, found):
        _check_corners(context, seen, found)


def _resolved(seen: Analysed, task: Task) -> bool:
    """Whether the plant's steps resolve all contacts of a stage in a world (TS307)."""
    context = seen.context
    for name in seen.pressed:
        believed, true = context.compliances[name], getattr(task.world[name], "stiffness", 0.0)
        k = believed.stiffness if true == "rigid" else float(true)
        if believed.phase * math.sqrt(k / believed.stiffness) > RESOLVED_PHASE:
            return False
    return True


def _check_nominal(context: Context, seen: Analysed, found: Diagnostics) -> bool:
    """Whether the stage is stable in the world of the file; reports where it is not, or rings."""
    modes = seen.modes()
    worst = _worst(modes)
    if worst is None:
        return True
    if grows(worst):
        text = f"stage {seen.stage.name!r} is unstable"
        _report(context, seen, worst, found, "TS501", Severity.ERROR, text)
        return False
    ringing = _ringing(modes)
    if ringing is not None:
        text = f"stage {seen.stage.name!r} rings"
        _report(context, seen, ringing, found, "TS502", Severity.WARNING, text)
        return False
    return True


def _check_corners(context: Context, seen: Analysed, found: Diagnostics) -> None:
    """Reports the worst world that `vary` allows, if that is unstable or rings."""
    objects = [*seen.pressed, *([seen.stage.held] if seen.stage.held else [])]
    unstable: tuple[float, Corner] | None = None
    ringing: tuple[float, Corner] | None = None
    for corner in corners(context, objects):
        if not _resolved(seen, corner.task):
            continue
        modes = seen.modes(corner.task)
        worst, swings = _worst(modes), _ringing(modes)
        if worst is not None and grows(worst) and (unstable is None or worst.s.real > unstable[0]):
            unstable = (worst.s.real, corner)
        if swings is not None and (ringing is None or swings.damping_ratio < ringing[0]):
            ringing = (swings.damping_ratio, corner)
    name = seen.stage.name
    if unstable is not None:
        corner, mode = _decisive(context, seen, unstable[1], lambda modes: modes[0].s.real)
        text = f"stage {name!r} is unstable in a world that `vary` allows, {_named(corner)}"
        _report(context, seen, mode, found, "TS503", Severity.ERROR, text, corner)
    elif ringing is not None:
        corner, _ = _decisive(context, seen, ringing[1], _undamped)
        swings = _ringing(seen.modes(corner.task))
        assert swings is not None
        text = f"stage {name!r} rings in a world that `vary` allows, {_named(corner)}"
        _report(context, seen, swings, found, "TS504", Severity.WARNING, text, corner)


def _undamped(modes: Sequence[Mode]) -> float:
    """How far a ringing is from being damped."""
    ringing = _ringing(modes)
    return 0.0 if ringing is None else LEAST_DAMPING_RATIO - ringing.damping_ratio


def _decisive(
    context: Context, seen: Analysed, corner: Corner, bad: Callable[[Sequence[Mode]], float]
) -> tuple[Corner, Mode]:
    """The corner without what does not matter, and the least stable mode there."""
    for part in list(corner.values):
        rest = {key: value for key, value in corner.values.items() if key != part}
        if not rest:
            break
        without = at(context, rest)
        if bad(seen.modes(without.task)) > _AS_MUCH * bad(seen.modes(corner.task)):
            corner = without
    return corner, seen.modes(corner.task)[0]


def _worst(modes: Sequence[Mode]) -> Mode | None:
    return modes[0] if modes else None


def _ringing(modes: Sequence[Mode]) -> Mode | None:
    """The least damped of the modes that ring."""
    found = [mode for mode in modes if rings(mode)]
    return min(found, key=lambda m: m.damping_ratio) if found else None


def _report(
    context: Context,
    seen: Analysed,
    mode: Mode,
    found: Diagnostics,
    code: str,
    severity: Severity,
    text: str,
    corner: Corner | None = None,
) -> None:
    axis = seen.axis(mode)
    limits = _mending(context, seen, axis, None if corner is None else corner.task, mode)
    place = _place(context, seen, axis, limits)
    if corner is not None:
        place = context.loaded.span(("vary", next(iter(corner.values))[0]))
    if place is not None and found.says(code, place):
        return
    message = f"{text}: {on_axis(axis)} {describe(mode, context.period)}"
    hint = "; or ".join(_said(limit) for limit in limits)
    found.add(severity, code, message, place, hint or "no single gain of this stage mends that")


def describe(mode: Mode, period: float) -> str:
    """What a mode does, as a predicate: how fast it swings, and grows or dies away.

    Args:
        mode: the mode. period: of control [s].
    """
    rate = mode.s.real
    if mode.frequency > 0.4 / period:
        size = number(abs(mode.z), 3)
        return f"is predicted to flip from tick to tick, each time {size} times as far"
    swings = f"ring at {show(mode.frequency, 'Hz', 3)}" if mode.frequency > 0 else "run away"
    time = math.log(2) / abs(rate) if rate else math.inf
    if rate > 0:
        return f"is predicted to {swings} and to double every {_time(time)}"
    return (
        f"is predicted to {swings} with a damping ratio of {number(mode.damping_ratio, 2)}, "
        f"halving every {_time(time)}"
    )


def on_axis(axis: str) -> str:
    """A mode's place in a sentence."""
    return "the null space" if axis == "null space" else f"axis {axis!r}"


def _time(seconds: float) -> str:
    return show(seconds, "ms" if seconds < 1 else "s", 2)


def _mending(
    context: Context, seen: Analysed, axis: str, task: Task | None, mode: Mode
) -> list[Limit]:
    """What would mend the stage: gains of the file before designed ones, a softer contact."""
    own = seen.stage.gains
    axes = [axis] if any(axis in by for by in own.values()) else list(seen.stage.axes)
    search = Search(context, seen, task, stable if grows(mode) else quiet)
    best = list(itertools.islice(search.gains(axes, given=True), _MOST_PROPOSED))
    if not best:
        best = list(itertools.islice(search.gains(axes, given=False), _MOST_PROPOSED))
    for name in seen.pressed:
        if task is None and name in context.surfaces:
            limit = search.stiffness(name)
            best += [limit] if limit is not None and limit.upper else []
    return best


def _said(limit: Limit) -> str:
    way = "up to" if limit.upper else "from"
    if not limit.on:
        return f"a contact of {way} {show(_inside(limit), 'kN/m', 3)}"
    what = "damping" if limit.what == "joint_damping" else limit.what
    unit = _UNITS[limit.what][limit.on.startswith(("r", "joint"))]
    value = number(_inside(limit), 3)
    return f"{what} {way} {f'{value} {unit}'.strip()}"


def _inside(limit: Limit) -> float:
    """The boundary in three digits, rounded to the stable side."""
    scale = 10.0 ** (math.floor(math.log10(limit.value)) - 2)
    rounding = math.floor if limit.upper else math.ceil
    return rounding(limit.value / scale) * scale


def _place(context: Context, seen: Analysed, axis: str, limits: Sequence[Limit]) -> Span | None:
    """The gain to be changed, if it stands in the file, else any on the axis, else the law."""
    gains = seen.stage.gains
    wanted = [limit.what for limit in limits if limit.given and limit.on]
    wanted += [g for g in PROPOSED if axis in gains.get(g, {}) and gains[g][axis].origin == "file"]
    name = seen.stage.name
    stage = context.loaded.task.stages[name]
    law: tuple[str, ...] = ("stages", name, "law") if stage.law is not None else ("law",)
    for what in wanted:
        entry = stage.axes.get(axis)
        if entry is not None and getattr(entry, what, None) is not None:
            return context.loaded.span(("stages", name, "axes", axis, what))
        keys = ("damping",) if what == "joint_damping" else tuple(what.split("."))
        last = axis if len(axis) <= 2 else ""
        return context.loaded.span((*law, *keys, last))
    if stage.law is None and "law" not in context.loaded.root.entries:
        return context.loaded.span(("stages", name, "axes", axis))
    return context.loaded.span(law)


def _named(corner: Corner) -> str:
    """The values of a corner, as the file would have them."""
    parts = []
    for (path, index), value in corner.values.items():
        component = "" if index is None else f"[{index}]"
        parts.append(f"{path}{component} = {_value(path, value)}")
    return ", ".join(parts)


def _value(path: str, value: float) -> str:
    key = path.rsplit(".", 1)[1]
    units = {
        "stiffness": "kN/m", "damping": "N*s/m", "mass": "kg", "inertia": "kg*m^2", "rpy": "deg",
        "joint_damping": "N*m*s/rad", "delay": "ms", "filter": "Hz",
    }  # fmt: skip
    return show(value, units[key], 3)
