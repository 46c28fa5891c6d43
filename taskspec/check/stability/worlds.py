"""Stages in the worlds that `vary` allows: the least stable of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from taskspec.analysis.budget import Budget
from taskspec.analysis.corners import Corner, at, corners
from taskspec.analysis.environment import linear_plant
from taskspec.analysis.loop import Mode, Poles
from taskspec.analysis.margin import LEAST_DAMPING_RATIO, LEAST_GROWTH, QUICK, grows, rings
from taskspec.analysis.plant import LinearPlant, pressing
from taskspec.analysis.stage import Analysed
from taskspec.check.stability.reporting import named, report
from taskspec.program.context import Context
from taskspec.program.world.stiffness import RESOLVED_PHASE
from taskspec.spec import Task
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, Severity

register(
    {
        "TS503": "a stage that is unstable in a world that `vary` allows",
        "TS504": "a stage that rings in a world that `vary` allows",
    }
)

#: A varied value is left out of a message if without it a mode grows, or is damped, as much.
_AS_MUCH = 0.95


class Plants:
    """Arm and contacts of worlds, which stages that touch the same have in common."""

    def __init__(self) -> None:
        self._known: dict[object, LinearPlant] = {}

    def under(self, seen: Analysed, corner: Corner) -> LinearPlant:
        """The plant that a stage drives in a world."""
        key = (tuple(seen.pressed), seen.sticking, corner.plant)
        if key not in self._known:
            ones = dict.fromkeys(seen.pressed, 1.0)
            self._known[key] = linear_plant(seen.context, corner.task, ones, sticking=seen.sticking)
        return pressing(self._known[key], seen.pressed)


@dataclass(frozen=True, slots=True)
class Shared:
    """What the stages of a file have in common.

    Attributes:
        plants: of worlds. gains: that may still be searched. worlds: that may still be looked at.
    """

    plants: Plants
    gains: Budget
    worlds: Budget


def check_worlds(context: Context, seen: Analysed, shared: Shared, found: Diagnostics) -> None:
    """Reports the worst world that `vary` allows, if that is unstable or rings."""
    objects = [*seen.pressed, *([seen.stage.plan.held] if seen.stage.plan.held else [])]
    unstable: tuple[float, Corner] | None = None
    ringing: tuple[float, Corner] | None = None
    for corner in corners(context, objects, shared.worlds):
        if not resolved(seen, corner.task):
            continue
        plant = shared.plants.under(seen, corner)
        growth, damping = _suspected(seen.poles(corner.task, plant))
        # Few corners are worse than all before them: only these are looked at in full.
        worse = growth > (LEAST_GROWTH if unstable is None else unstable[0])
        weaker = unstable is None and damping < (
            LEAST_DAMPING_RATIO if ringing is None else ringing[0]
        )
        if not (worse or weaker):
            continue
        modes = seen.modes(corner.task, plant)
        worst, swings = worst_of(modes), ringing_of(modes)
        if worst is not None and grows(worst) and (unstable is None or worst.s.real > unstable[0]):
            unstable = (worst.s.real, corner)
        if swings is not None and (ringing is None or swings.damping_ratio < ringing[0]):
            ringing = (swings.damping_ratio, corner)
    name = seen.stage.name
    if unstable is not None:
        corner, mode = _decisive(context, seen, unstable[1], lambda modes: modes[0].s.real)
        text = f"stage {name!r} is unstable in a world that `vary` allows, {named(corner)}"
        report(context, seen, mode, found, shared.gains, "TS503", Severity.ERROR, text, corner)
    elif ringing is not None:
        corner, _ = _decisive(context, seen, ringing[1], _undamped)
        swings = ringing_of(seen.modes(corner.task))
        assert swings is not None
        text = f"stage {name!r} rings in a world that `vary` allows, {named(corner)}"
        report(context, seen, swings, found, shared.gains, "TS504", Severity.WARNING, text, corner)


def _suspected(s: Poles) -> tuple[float, float]:
    """Fastest growth [1/s], and least damping ratio of what dies away slowly, of some poles."""
    growth = float(s.real.max(initial=-math.inf))
    slow = s[-s.real < QUICK]
    return growth, float((-slow.real / np.abs(slow)).min(initial=math.inf))


def _undamped(modes: Sequence[Mode]) -> float:
    """How far a ringing is from being damped."""
    ringing = ringing_of(modes)
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


def resolved(seen: Analysed, task: Task) -> bool:
    """Whether the plant's steps resolve all contacts of a stage in a world (TS307)."""
    context = seen.context
    for name in seen.pressed:
        nominal, true = context.compliances[name], getattr(task.world[name], "stiffness", 0.0)
        k = nominal.stiffness if true == "rigid" else float(true)
        if nominal.phase * math.sqrt(k / nominal.stiffness) > RESOLVED_PHASE:
            return False
    return True


def worst_of(modes: Sequence[Mode]) -> Mode | None:
    """The least stable of all modes."""
    return modes[0] if modes else None


def ringing_of(modes: Sequence[Mode]) -> Mode | None:
    """The least damped of the modes that ring."""
    found = [mode for mode in modes if rings(mode)]
    return min(found, key=lambda m: m.damping_ratio) if found else None
