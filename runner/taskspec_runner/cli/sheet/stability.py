"""Predicted poles, margins and the textbook's conditions of a stage, as data for `explain`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.laws.conditions import StabilityCondition
from taskspec.laws.law import gain_named
from taskspec.program.program import Program
from taskspec.stability.gain_paths import turns
from taskspec.stability.loop import Mode, UnfitError
from taskspec.stability.margin import (
    DELAY,
    MOTION,
    OF_THE_ROBOT,
    Limit,
    Search,
    grows,
    rings,
)
from taskspec.stability.sampled_stage import SampledStage, loop_of
from taskspec.stability.textbook import conditions
from taskspec.text.units import FORCE, STIFFNESS, TIME, number, scaled, show

#: Poles that are shown, the least stable ones.
_MOST = 6
#: What is gone after one tick is no pole that anyone looks for.
_AT_ONCE = 1e-3
#: Bounds of motion loops that are farther off than so many times their gain say nothing.
_NEAR = 5.0
#: Slower swinging than this is rounding [Hz].
_STILL = 1e-6


@dataclass(frozen=True, slots=True)
class PoleRow:
    """A mode: the axis that moves most, its frequency, damping ratio and time constant."""

    axis: str
    frequency: str
    damping: str
    time: str
    verdict: str


@dataclass(frozen=True, slots=True)
class BoundRow:
    """A value that bounds a gain or a contact: where it comes from, and whether it is kept."""

    what: str
    now: str
    bound: str
    source: str


@dataclass(frozen=True, slots=True)
class StabilitySheet:
    """The sampled closed loop of a stage: where it is looked at, its poles and its bounds."""

    where: str
    poles: tuple[PoleRow, ...]
    bounds: tuple[BoundRow, ...]


def stability_sheet(program: Program, name: str) -> StabilitySheet | None:
    """A stage by its name; None where it controls joints, or is free and far from every bound."""
    if program.plan.stages[name].joint_path is not None:
        return None
    try:
        sampled = loop_of(program.plan, name)
        if sampled is None:
            return None
        modes = sampled.modes()
        bounds = tuple(_bounds(program, sampled))
    except (UnfitError, np.linalg.LinAlgError):
        return None
    if not (bounds or sampled.pressed or sampled.stage.plan.contacts.held):
        return None
    return StabilitySheet(_where(sampled), tuple(_poles(sampled, modes)), bounds)


def _where(sampled: SampledStage) -> str:
    parts = [
        f"{show(force, FORCE.on(rotation=_angular(sampled, name)), 3)} on {name}"
        for name, force in sampled.pressed.items()
    ]
    held = sampled.stage.plan.contacts.held
    parts += [f"{held} held"] if held else []
    parts += [f"on {name}" for name in sampled.context.bushings]
    parts = parts or ["nothing touched"]
    return f"{'in contact, ' if sampled.meets else ''}{', '.join(parts)}, at the start pose"


def _angular(sampled: SampledStage, name: str) -> bool:
    return name in sampled.context.equations and sampled.context.equations[name].angular


def _poles(sampled: SampledStage, modes: tuple[Mode, ...]) -> Iterator[PoleRow]:
    """The least stable modes; of equal ones the axes together."""
    found: dict[tuple[str, str, str, str], set[str]] = {}
    for mode in modes:
        if abs(mode.z) > _AT_ONCE:
            found.setdefault(_cells(mode), set()).add(sampled.axis(mode))
    order = [*sampled.stage.plan.axes, *sampled.stage.plan.active, "null space"]
    for cells, axes in list(found.items())[:_MOST]:
        yield PoleRow(" ".join(sorted(axes, key=order.index)), *cells)


def _cells(mode: Mode) -> tuple[str, str, str, str]:
    rate = mode.s.real
    time = abs(1 / rate) if rate else float("inf")
    swings = mode.frequency > _STILL
    said = "unstable" if grows(mode) else "rings" if rings(mode) else ""
    return (
        show(mode.frequency, "Hz", 3) if swings else "-",
        number(mode.damping_ratio, 2) if swings else "-",
        scaled(time, TIME, 3),
        said,
    )


def _bounds(program: Program, sampled: SampledStage) -> Iterator[BoundRow]:
    """What the sampled model allows, and beside it what the textbook does."""
    search = Search(program.context, sampled)
    forced = [a for a, p in sampled.stage.plan.plans.items() if p.force] + list(
        sampled.stage.plan.active
    )
    near = replace(search, reach=_NEAR)
    moved = [a for a in sampled.stage.plan.axes if a not in forced]
    for limit in (*search.gains(forced), *near.gains(moved, of=MOTION)):
        yield BoundRow(*_limit(sampled, limit), "this stage as it is sampled")
    for name in sampled.pressed:
        if name in sampled.context.surfaces:
            found = search.stiffness(name)
            if found is not None:
                yield BoundRow(
                    f"stiffness of {name}",
                    scaled(found.now, STIFFNESS),
                    f"{'<' if found.upper else '>'} {scaled(found.value, STIFFNESS)}",
                    "this stage as it is sampled",
                )
    for limit in search.robot():
        unit, way = OF_THE_ROBOT[limit.what], "<" if limit.upper else ">"
        most = f"{'<=' if limit.what == DELAY else way} {scaled(limit.value, unit, 3)}"
        yield BoundRow(limit.what, scaled(limit.now, unit), most, "this stage as it is sampled")
    for condition in conditions(sampled):
        yield _condition(condition)


def _limit(sampled: SampledStage, limit: Limit) -> tuple[str, str, str]:
    first, gain = limit.on[0], gain_named(limit.what)
    angular = turns(sampled.context, first)
    way = "<" if limit.upper else ">"
    return (
        f"{limit.what} on {first if limit.what == 'joint_damping' else ' '.join(limit.on)}",
        gain.text(limit.now, angular=angular),
        f"{way} {gain.text(limit.value, angular=angular)}",
    )


def _condition(condition: StabilityCondition) -> BoundRow:
    way = "<" if condition.upper else ">"
    kept = "" if condition.holds else ", not kept"
    gain = gain_named(condition.gain)
    return BoundRow(
        f"{condition.gain} on {condition.axis}",
        gain.text(condition.now, angular=False),
        f"{way} {gain.text(condition.bound, angular=False)}",
        f"{condition.equation}: {condition.text}{kept}",
    )
