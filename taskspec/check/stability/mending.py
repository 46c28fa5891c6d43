"""What would mend a stage that is unstable or rings, in words, and where in the file that is."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from taskspec.analysis.loop import Mode
from taskspec.analysis.margin import PROPOSED, Limit, Search, grows, quiet, stable
from taskspec.analysis.stage import Analysed
from taskspec.program.context import Context
from taskspec.spec import Task
from taskspec.text.show import number, show
from taskspec.text.source import Span

#: No more ways to mend a stage are proposed than these of its gains.
_MOST_PROPOSED = 2

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


def mending(
    context: Context, seen: Analysed, axis: str, task: Task | None, mode: Mode
) -> list[Limit]:
    """What would mend the stage: gains of the file before designed ones, a softer contact.

    Args:
        context: the task. seen: the stage. axis: on which `mode` moves most.
        task: whose world and robot are true; None for the believed ones. mode: that is to go.
    """
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


def said(limit: Limit) -> str:
    """A boundary as a way to mend a stage, in words."""
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


def place_of(context: Context, seen: Analysed, axis: str, limits: Sequence[Limit]) -> Span | None:
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
