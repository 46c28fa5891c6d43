"""Axes that hold the force of the stage before: which stages that are, and what is known of it."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.expression import Expression
from taskspec.expression.tree import Number
from taskspec.geometry.axis import Axis
from taskspec.program.context import Context
from taskspec.program.flow import followers
from taskspec.program.known_value import known_value
from taskspec.spec import Stage, Task


def with_kept_forces(context: Context, name: str) -> Stage:
    """A stage whose kept forces are known, where all stages before it command one and the same."""
    stage = context.loaded.task.stages[name]
    kept = [a for a, entry in stage.axes.items() if entry.set_point and entry.set_point.kept]
    if not kept:
        return stage
    axes = dict(stage.axes)
    for axis in kept:
        axes[axis] = axes[axis].keeping(_known(context, name, axis))
    return stage.model_copy(update={"axes": axes})


def before(task: Task, name: str) -> list[str]:
    """The stages that may lead to one, itself left out."""
    return [each for each in task.stages if each != name and name in followers(task, each)]


def _known(context: Context, name: str, axis: Axis) -> Expression | None:
    """The force that an axis keeps; None where it depends on place or time."""
    values = set(_values(context, name, axis, frozenset({name})))
    if len(values) != 1:
        return None
    (value,) = values
    entry = context.loaded.task.stages[name].axes[axis]
    assert entry.set_point is not None
    point = entry.set_point.wanted
    if value is None:
        return None
    return Expression(point.text, Number(value, point.dimension), point.dimension)


def _values(
    context: Context, name: str, axis: Axis, visited: frozenset[str]
) -> Iterator[float | None]:
    """Set points with which stages lead to one [N, N m]; None for one that is not constant."""
    task = context.loaded.task
    for each in before(task, name):
        entry = task.stages[each].axes.get(axis)
        force = None if entry is None else entry.set_point
        if each in visited:
            continue
        if force is not None and force.kept:
            yield from _values(context, each, axis, visited | {each})
        else:
            yield 0.0 if force is None else known_value(context, force.wanted)
