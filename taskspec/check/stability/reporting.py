"""What is told about a stage that is unstable or rings."""

from __future__ import annotations

import math

from taskspec.analysis.budget import Budget
from taskspec.analysis.corners import Corner
from taskspec.analysis.loop import Mode
from taskspec.analysis.stage import Analysed
from taskspec.check.stability.mending import mending, place_of, said
from taskspec.program.context import Context
from taskspec.spec import FILE
from taskspec.text.diagnostic import Diagnostics, Severity
from taskspec.text.show import number, show


def report(
    context: Context,
    seen: Analysed,
    mode: Mode,
    found: Diagnostics,
    budget: Budget,
    code: str,
    severity: Severity,
    text: str,
    corner: Corner | None = None,
) -> None:
    """Reports a mode of a stage, with what would mend it.

    Args:
        context: the task. seen: the stage. mode: the mode. found: where findings go.
        budget: of gains that may still be searched in this file. code, severity, text: of it.
        corner: the world in which it is so; None for that of the file.
    """
    axis = seen.axis(mode)
    if corner is None:
        limits = mending(context, seen, axis, None, mode, budget)
        place = place_of(context, seen, axis, limits)
    else:
        place = context.loaded.span(FILE.vary[next(iter(corner.values))[0]])
    if place is not None and found.says(code, place):
        return
    if corner is not None:
        limits = mending(context, seen, axis, corner.task, mode, budget)
    message = f"{text}: {on_axis(axis)} {describe(mode, context.period)}"
    hint = "; or ".join(said(context, seen, limit) for limit in limits)
    if not hint:
        none = "no single gain of this stage mends that"
        hint = none if budget.left > 0 else "what mends that is told once other stages are mended"
    found.add(severity, code, message, place, hint)


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


def named(corner: Corner) -> str:
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
