"""Worlds under `vary` that there are none of: a stiffness below zero, a mass of none."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.components import ends, nominal
from taskspec.program.plan import TaskPlan
from taskspec.program.world.holding import truly_holding
from taskspec.robot import RobotError
from taskspec.rules import Finding, Phase, error, rule
from taskspec.spec import FILE
from taskspec.text.units import in_si


@rule({}, also=("TS106",), phase=Phase.VARIATIONS)
def shares_of_zero(task: TaskPlan) -> Iterator[Finding]:
    """Variations by a percentage of a value that is 0."""
    context = task.context
    for path, components in context.loaded.task.vary.items():
        for i, variation in enumerate(components):
            if variation is None or not variation.share:
                continue
            index = i if len(components) > 1 else None
            if nominal(context, path, index) == 0:
                yield error(
                    "TS106",
                    f"{path!r} is 0 in the file, and a percentage of 0 is a tolerance of no width",
                    FILE.vary[path] if index is None else FILE.vary[path][index],
                    "write the width itself, with its unit",
                )


@rule({}, also=("TS118",), phase=Phase.VARIATIONS)
def impossible_variations(task: TaskPlan) -> Iterator[Finding]:
    """Variations whose lower end is a value that the file itself could not state."""
    context = task.context
    for path, components in context.loaded.task.vary.items():
        target = context.loaded.task.target_of(path)
        if target.above is None and target.least is None:
            continue
        positive = target.above is not None
        for i, variation in enumerate(components):
            if variation is None:
                continue
            index = i if len(components) > 1 else None
            middle = nominal(context, path, index) if variation.relative else 0.0
            low, _ = ends(context, path, index, variation)
            if low > 0 or (low == 0 and not positive):
                continue
            unit = target.dimensions[i]
            declared = f", from {in_si(middle, unit)} in the file" if variation.relative else ""
            yield error(
                "TS118",
                f"this lets {path!r} become {in_si(low, unit)}{declared}: it has to be "
                f"{'above 0' if positive else '0 or more'}",
                FILE.vary[path] if index is None else FILE.vary[path][index],
                "narrow the interval, or write its ends: a..b",
                stops=True,
            )


@rule({}, also=("TS412",), phase=Phase.VARIATIONS)
def held_out_of_reach(task: TaskPlan) -> Iterator[Finding]:
    """What the robot holds from the start, and `truth` has where the arm does not get."""
    loaded = task.context.loaded
    try:
        truly_holding(task.context, loaded.true_task)
    except RobotError as found:
        name = (loaded.task.robot.grasp or "").partition(".")[0]
        path = next(p for p in loaded.task.truth.paths if p.startswith(f"world.{name}."))
        yield error("TS412", found.message, FILE.truth[path], found.hint, stops=True)
