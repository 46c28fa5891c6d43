"""Worlds that `vary` allows: corners of what the stability of a stage depends on."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

from taskspec.deferred_methods import dataclass
from taskspec.program.components import (
    Component,
    components,
    ends,
    nominal,
    otherwise,
    true_task_with,
)
from taskspec.program.context import Context
from taskspec.spec import Task, Variation
from taskspec.spec.value_path import ValuePath
from taskspec.stability.budget import Budget

#: Up to so many components all corners are tried, beyond that one at a time.
MOST_AT_ONCE = 6
_OF_OBJECTS = ("stiffness", "damping", "mass", "inertia", "rpy")
_OF_THE_ROBOT = (
    *("robot.joint_damping", "robot.sensor.delay", "robot.sensor.filter"),
    *(f"robot.servo.{key}" for key in ("bandwidth", "damping", "delay", "stiffness")),
)


@dataclass(frozen=True, slots=True)
class Uncertain:
    """One random number, and what follows from it.

    Attributes:
        name: of the number.
        values: of it that are tried, the ends and for a stiffness the middle.
    """

    name: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Corner:
    """One world.

    Attributes:
        values: by component, as in `Uncertain`.
        task: with these values.
    """

    values: Mapping[Component, float]
    task: Task

    @property
    def plant(self) -> tuple[tuple[Component, float], ...]:
        """Values that arm and contact depend on: the sensor is none of theirs."""
        return tuple(
            (key, value)
            for key, value in self.values.items()
            if not key[0].startswith("robot.sensor.")
        )


def corners(context: Context, objects: Sequence[str], budget: Budget) -> Iterator[Corner]:
    """The worlds to try for a stage.

    Args:
        context: the task.
        objects: that the stage touches or holds.
        budget: of worlds; where all are more than that, one value varies at a time.
    """
    found = dict(components(context, lambda path: _matters(path, objects)))
    parts = list(_uncertain(context, found))
    if not parts:
        if truth := otherwise(context, lambda path: _matters(path, objects)):
            yield at(context, truth)
        return
    count = math.prod(len(part.values) for part in parts)
    if len(parts) <= MOST_AT_ONCE and budget.take(count):
        for values in itertools.product(*(part.values for part in parts)):
            drawn = {part.name: value for part, value in zip(parts, values, strict=True)}
            yield _corner(context, found, drawn)
        return
    for part in parts:
        for value in part.values:
            yield _corner(context, found, {part.name: value})


def at(context: Context, values: Mapping[Component, float]) -> Corner:
    """The true world with some components at given values [SI]."""
    return Corner(values, true_task_with(context, values))


def _corner(
    context: Context, varied: Mapping[Component, Variation], drawn: Mapping[str, float]
) -> Corner:
    """The world of some draws; what follows from others stays as it is."""
    values = {
        part: each.value(nominal(context, *part), drawn)
        for part, each in varied.items()
        if all(draw.name in drawn for draw in each.draws)
    }
    return at(context, values)


def _matters(path: str, objects: Sequence[str]) -> bool:
    of = ValuePath.of(path)
    if of.section == "world":
        return of.owner in objects and of.key in _OF_OBJECTS
    return path in _OF_THE_ROBOT


def _uncertain(context: Context, varied: Mapping[Component, Variation]) -> Iterator[Uncertain]:
    seen = set()
    for part, variation in varied.items():
        for draw in variation.draws:
            if draw.name in seen:
                continue
            seen.add(draw.name)
            values: tuple[float, ...] = (draw.low, draw.high)
            if variation.formula is None:
                low, high = ends(context, *part, variation)
                if part[0].endswith(".stiffness") and low > 0:
                    middle = variation.drawn(math.sqrt(low * high), nominal(context, *part))
                    values = (draw.low, middle, draw.high)
            yield Uncertain(draw.name, values)
