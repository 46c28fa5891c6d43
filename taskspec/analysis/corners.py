"""Worlds that `vary` allows: corners of what the stability of a stage depends on."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from taskspec.analysis.budget import Budget
from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.spec import Task, Variation

#: Up to so many components all corners are tried, beyond that one at a time.
MOST_AT_ONCE = 6
_OF_OBJECTS = ("stiffness", "damping", "mass", "inertia", "rpy")
_OF_THE_ROBOT = ("robot.joint_damping", "robot.sensor.delay", "robot.sensor.filter")


@dataclass(frozen=True, slots=True)
class Uncertain:
    """One component that varies.

    Attributes:
        path: of the value in the file.
        index: of the component, None for a single number.
        values: that are tried, the ends and for a stiffness the middle [SI].
    """

    path: str
    index: int | None
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Corner:
    """One world.

    Attributes:
        values: by component, as in `Uncertain`.
        task: with these values.
    """

    values: Mapping[tuple[str, int | None], float]
    task: Task

    @property
    def plant(self) -> tuple[tuple[tuple[str, int | None], float], ...]:
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
    parts = list(_uncertain(context, objects))
    if not parts:
        return
    count = math.prod(len(part.values) for part in parts)
    if len(parts) <= MOST_AT_ONCE and budget.take(count):
        chosen = itertools.product(*(part.values for part in parts))
        for values in chosen:
            yield _corner(context, parts, values)
        return
    for part in parts:
        for value in part.values:
            yield _corner(context, [part], [value])


def at(context: Context, values: Mapping[tuple[str, int | None], float]) -> Corner:
    """The world with some components at given values [SI]."""
    task = context.loaded.task
    for (path, index), value in values.items():
        task = changed(task, path, index, value)
    return Corner(values, task)


def _corner(context: Context, parts: Sequence[Uncertain], values: Sequence[float]) -> Corner:
    return at(context, {(p.path, p.index): v for p, v in zip(parts, values, strict=True)})


def _uncertain(context: Context, objects: Sequence[str]) -> Iterator[Uncertain]:
    for path, components in context.loaded.task.vary.items():
        section, _, rest = path.partition(".")
        name, _, key = rest.partition(".")
        if section == "world" and (name not in objects or key not in _OF_OBJECTS):
            continue
        if section == "robot" and path not in _OF_THE_ROBOT:
            continue
        for i, variation in enumerate(components):
            if variation is None:
                continue
            index = i if len(components) > 1 else None
            yield Uncertain(path, index, _values(context, path, index, variation))


def _values(
    context: Context, path: str, index: int | None, variation: Variation
) -> tuple[float, ...]:
    low, high = ends(context, path, index, variation)
    if path.endswith(".stiffness") and low > 0:
        return (low, float(np.sqrt(low * high)), high)
    return (low, high)


def ends(
    context: Context, path: str, index: int | None, variation: Variation
) -> tuple[float, float]:
    """Least and greatest value of a component that varies [SI]."""
    return variation.ends(nominal(context, path, index) if variation.relative else 0.0)


def nominal(context: Context, path: str, index: int | None) -> float:
    """The value in the file, or what stands for it [SI]."""
    section, _, rest = path.partition(".")
    name, _, key = rest.partition(".")
    task = context.loaded.task
    if section == "world" and key in ("stiffness", "damping") and name in context.compliances:
        return float(getattr(context.compliances[name], key))
    found: Any = task.world[name] if section == "world" else task.robot
    for step in (key if section == "world" else rest).split("."):
        found = None if found is None else getattr(found, step)
    if found is None:
        return 0.0
    if index is not None or isinstance(found, tuple):
        return float(found[index or 0])
    return float(found)


def changed(task: Task, path: str, index: int | None, value: float) -> Task:
    """The task with one component of a value of `world` or `robot` changed."""
    section, _, rest = path.partition(".")
    if section == "world":
        name, _, key = rest.partition(".")
        world = {**task.world, name: _set(task.world[name], [key], index, value)}
        return task.model_copy(update={"world": world})
    return task.model_copy(update={"robot": _set(task.robot, rest.split("."), index, value)})


def _set(model: Any, steps: Sequence[str], index: int | None, value: float) -> Any:
    key, *rest = steps
    old = getattr(model, key)
    new: Any = value
    if rest:
        new = _set(old, rest, index, value)
    elif index is not None:
        new = tuple(value if i == index else part for i, part in enumerate(old))
    elif isinstance(old, tuple):
        new = (value,) * len(old)
    return model.model_copy(update={key: new})
