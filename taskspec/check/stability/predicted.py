"""Stages whose sampled closed loop is predicted to be unstable, or to ring."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.corners import Corner, at, corners
from taskspec.analysis.environment import linear_plant
from taskspec.analysis.loop import Mode, UnfitError
from taskspec.analysis.margin import LEAST_DAMPING_RATIO, LEAST_GROWTH, QUICK, grows, rings
from taskspec.analysis.plant import LinearPlant, pressing
from taskspec.analysis.stage import Analysed, analyse
from taskspec.check.stability.mending import mending, place_of, said
from taskspec.program.context import Context
from taskspec.program.world.stiffness import RESOLVED_PHASE
from taskspec.spec import Axis, Stage, Task
from taskspec.text.diagnostic import Diagnostics, Severity
from taskspec.text.show import number, show

#: A varied value is left out of a message if without it a mode grows, or is damped, as much.
_AS_MUCH = 0.95


def check_stability(context: Context, found: Diagnostics) -> None:
    """Reports stages that are predicted to be unstable or to ring, each way of control once."""
    seen: set[str] = set()
    plants = _Plants()
    for name, stage in context.loaded.task.stages.items():
        key = _control(context, stage)
        if key in seen:
            continue
        seen.add(key)
        try:
            _check_stage(context, name, plants, found)
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


def _check_stage(context: Context, name: str, plants: _Plants, found: Diagnostics) -> None:
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
        _check_corners(context, seen, plants, found)
        _check_sticking(context, seen, found)


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


def _check_sticking(context: Context, seen: Analysed, found: Diagnostics) -> None:
    """Reports a stage that is stable while the tool slides, but not while friction holds it."""
    stuck = seen.stuck()
    worst = None if stuck is None else _worst(stuck.modes())
    if stuck is not None and worst is not None and grows(worst):
        text = f"stage {seen.stage.name!r} is unstable while friction holds the tool"
        _report(context, stuck, worst, found, "TS506", Severity.WARNING, text)


def _check_corners(context: Context, seen: Analysed, plants: _Plants, found: Diagnostics) -> None:
    """Reports the worst world that `vary` allows, if that is unstable or rings."""
    objects = [*seen.pressed, *([seen.stage.held] if seen.stage.held else [])]
    unstable: tuple[float, Corner] | None = None
    ringing: tuple[float, Corner] | None = None
    for corner in corners(context, objects):
        if not _resolved(seen, corner.task):
            continue
        plant = plants.under(seen, corner)
        growth, damping = _suspected(seen.poles(corner.task, plant))
        # Few corners are worse than all before them: only these are looked at in full.
        worse = growth > (LEAST_GROWTH if unstable is None else unstable[0])
        weaker = unstable is None and damping < (
            LEAST_DAMPING_RATIO if ringing is None else ringing[0]
        )
        if not (worse or weaker):
            continue
        modes = seen.modes(corner.task, plant)
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


def _suspected(s: NDArray[np.complex128]) -> tuple[float, float]:
    """Fastest growth [1/s], and least damping ratio of what dies away slowly, of some poles."""
    growth = float(s.real.max(initial=-math.inf))
    slow = s[-s.real < QUICK]
    return growth, float((-slow.real / np.abs(slow)).min(initial=math.inf))


class _Plants:
    """Arm and contacts of worlds, which stages that touch the same have in common."""

    def __init__(self) -> None:
        self._known: dict[object, LinearPlant] = {}

    def under(self, seen: Analysed, corner: Corner) -> LinearPlant:
        """The plant that a stage drives in a world."""
        key = (tuple(seen.pressed), corner.plant)
        if key not in self._known:
            ones = dict.fromkeys(seen.pressed, 1.0)
            self._known[key] = linear_plant(seen.context, corner.task, ones)
        return pressing(self._known[key], seen.pressed)


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
    limits = mending(context, seen, axis, None if corner is None else corner.task, mode)
    place = place_of(context, seen, axis, limits)
    if corner is not None:
        place = context.loaded.span(("vary", next(iter(corner.values))[0]))
    if place is not None and found.says(code, place):
        return
    message = f"{text}: {on_axis(axis)} {describe(mode, context.period)}"
    hint = "; or ".join(said(context, seen, limit) for limit in limits)
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
