"""Components of the values in which a world may differ from the nominal one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from taskspec.program.context import Context
from taskspec.spec import Task, Variation
from taskspec.spec.robot import JointEncoder, Noise, Payload
from taskspec.spec.value_path import ValuePath
from taskspec.spec.varied import VariedValue
from taskspec.text.units import SMALLEST

Component = tuple[str, int | None]
"""The path of a value and the number of its component, None for a single number."""


def components(
    context: Context, wanted: Callable[[str], bool] = lambda _: True
) -> Iterator[tuple[Component, Variation]]:
    """The components of `vary`, of the paths that are wanted, in the order of the file."""
    for path, entry in context.loaded.task.vary.items():
        if wanted(path):
            for i, variation in enumerate(entry):
                if variation is not None:
                    yield (path, i if len(entry) > 1 else None), variation


def otherwise(context: Context, wanted: Callable[[str], bool]) -> dict[Component, float]:
    """True values that differ from the nominal ones [SI], of the paths that are wanted."""
    loaded, found = context.loaded, {}
    for path in loaded.task.true_numbers:
        if not wanted(path):
            continue
        count = len(loaded.task.target_of(path).dimensions)
        for index in range(count) if count > 1 else (None,):
            declared, true = (
                value_of(context, t, path, index) for t in (loaded.task, loaded.true_task)
            )
            if declared != true:
                found[path, index] = true
    return found


def ends(
    context: Context, path: str, index: int | None, variation: Variation
) -> tuple[float, float]:
    """Least and greatest value of a component that varies [SI]: none that no world can have."""
    target = context.loaded.task.target_of(path)
    low, high = variation.ends(nominal(context, path, index) if variation.relative else 0.0)
    if any(draw.normal for draw in variation.draws):
        low, high = bounded(target, low), bounded(target, high)
    return low, high


def bounded(target: VariedValue, value: float) -> float:
    """A value [SI], or the nearest that there can be."""
    least = target.least
    if target.above is not None:
        least = target.above + SMALLEST
    if least is not None:
        value = max(value, least)
    return value if target.most is None else min(value, target.most)


def nominal(context: Context, path: str, index: int | None) -> float:
    """The value in the true world, or what stands for it [SI]."""
    return value_of(context, context.loaded.true_task, path, index)


def value_of(context: Context, task: Task, path: str, index: int | None) -> float:
    """The value that a task has, or what stands for it [SI]."""
    of = ValuePath.of(path)
    found: Any = task.world[of.owner] if of.section == "world" else task.robot
    for step in of.steps:
        found = None if found is None else getattr(found, step)
    stands_for = found is None or isinstance(found, str)
    if stands_for and of.key in ("stiffness", "damping") and of.owner in context.compliances:
        return float(getattr(context.compliances[of.owner], of.key))
    if found is None:
        return 0.0
    if index is not None or isinstance(found, tuple):
        return float(found[index or 0])
    return float(found)


def true_task_with(context: Context, values: Mapping[Component, float]) -> Task:
    """The true task with some components at given values [SI]."""
    task = context.loaded.true_task
    for (path, index), value in values.items():
        task = changed(task, path, index, value)
    return task


def changed(task: Task, path: str, index: int | None, value: float) -> Task:
    """The task with one component of a value of `world` or `robot` changed."""
    of = ValuePath.of(path)
    if of.section == "world":
        world = {**task.world, of.owner: _set(task.world[of.owner], of.steps, index, value)}
        return task.model_copy(update={"world": world})
    return task.model_copy(update={"robot": _set(task.robot, of.steps, index, value)})


#: What a value of the robot stands in where the file has none.
_ABSENT = {"encoder": JointEncoder(), "noise": Noise(), "payload": Payload()}


def _set(model: Any, steps: Sequence[str], index: int | None, value: float) -> Any:
    key, *rest = steps
    old = getattr(model, key)
    new: Any = value
    if rest:
        new = _set(_ABSENT[key] if old is None else old, rest, index, value)
    elif index is not None:
        new = tuple(value if i == index else part for i, part in enumerate(old))
    elif isinstance(old, tuple):
        new = (value,) * len(old)
    return model.model_copy(update={key: new})
