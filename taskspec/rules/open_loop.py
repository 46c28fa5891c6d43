"""Open-loop forces: what becomes of them where the true surface differs from the nominal one."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from taskspec.geometry.axis import Axis
from taskspec.laws.coupled import yielding_stiffness
from taskspec.laws.gains import value_of
from taskspec.program.components import ends, nominal
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.spec import FILE
from taskspec.text.units import FORCE, show

#: A force that comes to within this share of its set point on all surfaces is not vague.
_VAGUE = 0.05


@rule("TS303", "a force without a surface to press on", phase=Phase.PATH)
def forces_without_a_surface(stage: StagePlan) -> Iterator[Finding]:
    """Open-loop forces in a world that has no surface."""
    if _surfaceless(stage):
        first = _open_loop(stage)[0]
        yield error(
            "TS303",
            f"under {stage.law.kind!r} a force is reached by pressing below a surface, and the "
            "world has none",
            FILE.stages[stage.name].axes[first].force,
            "declare the surface under `world`, or use a law with a force loop: hybrid, "
            "parallel, parallel-pid",
        )


@rule("TS306", "an open-loop force on an axis without a spring", phase=Phase.PATH)
def forces_without_a_spring(stage: StagePlan) -> Iterator[Finding]:
    """Open-loop forces that would stretch a spring of no stiffness."""
    if _surfaceless(stage):
        return
    for axis in _open_loop(stage):
        if value_of(stage.gains, "stiffness", axis) == 0:
            yield error(
                "TS306",
                f"under {stage.law.kind!r} a force stretches the law's spring, and {axis!r} has "
                "none",
                FILE.stages[stage.name].axes[axis],
                "give the law a stiffness above zero, or use a law with a force loop",
            )


@rule("TS304", "an open-loop force that `vary` makes vague", phase=Phase.PATH)
def vague_forces(stage: StagePlan) -> Iterator[Finding]:
    """Open-loop forces that become others on the surfaces which `vary` allows."""
    if _surfaceless(stage):
        return
    for axis in _open_loop(stage):
        span = None if axis.is_rotation else _span(stage, axis)
        if span is not None:
            low, high = span
            yield warning(
                "TS304",
                f"under {stage.law.kind!r} this force is open loop: for the surfaces that `vary` "
                f"allows it becomes {show(low, FORCE, 3)} to {show(high, FORCE, 3)}",
                FILE.stages[stage.name].axes[axis].force,
                "a law with a force loop (hybrid, parallel, parallel-pid) reaches it on all",
            )


def _open_loop(stage: StagePlan) -> list[Axis]:
    """Axes whose force displaces their motion."""
    return [a for a, plan in stage.plans.items() if plan.open_loop]


def _surfaceless(stage: StagePlan) -> bool:
    """Whether a stage has open-loop forces, and nothing to press on or to hold.

    A force may also press on an equation of the world, or on a bushing.
    """
    alone = stage.contacts.main is None and not stage.contacts.gripped
    borne, springs = stage.environment.bearers, stage.environment.springs
    forces = (a for a in _open_loop(stage) if not a.is_rotation)
    return alone and not all(a in borne or springs(a) for a in forces)


def _span(stage: StagePlan, axis: Axis) -> tuple[float, float] | None:
    """Least and greatest force over `truth` and the corners of `vary`; None where it stays.

    From (4.26), (4.27) with the reference f (1/k_m + 1/k) below the nominal surface.
    """
    contact, value = stage.contacts.of(axis), stage.set_points.of(axis)
    own = yielding_stiffness(stage.gains, axis)
    if contact is None or value is None or own == 0:
        return None
    k, context = stage.environment.stiffness_of(axis), stage.context
    told = context.surfaces[contact].origin
    (stiffness,) = _ends(context, f"world.{contact}.stiffness", [k])
    places = _ends(context, f"world.{contact}.xyz", list(told))
    if len(stiffness) == 1 and all(len(p) == 1 for p in places):
        return None
    direction = stage.rotation[:, axis.column]
    forces = []
    for true_k, *place in itertools.product(stiffness, *places):
        depth = value * (1 / own + 1 / k) - float(direction @ (np.array(place) - told))
        forces.append(depth * own * true_k / (own + true_k))
    low, high = min(forces), max(forces)
    return (low, high) if max(high - value, value - low) > _VAGUE * abs(value) else None


def _ends(context: Context, path: str, told: list[float]) -> list[list[float]]:
    """Of each component what the file says, what is true, and the ends of what varies [SI]."""
    task, found = context.loaded.task, [[float(value)] for value in told]
    variations = task.vary.get(path, (None,) * len(told))
    for i, variation in enumerate(variations):
        part = (path, i if len(told) > 1 else None)
        if variation is not None:
            found[i] = list(ends(context, *part, variation))
        elif path in task.true_numbers and (true := nominal(context, *part)) != found[i][0]:
            found[i].append(true)
    return found
