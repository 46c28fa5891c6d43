"""Worlds that `vary` allows, for what is at rest in a contact: its stiffness and its place."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator

import casadi as ca

from taskspec.deferred_methods import dataclass
from taskspec.prediction.types import Extreme, Values
from taskspec.program.components import changed, ends, otherwise
from taskspec.program.context import Context
from taskspec.program.prepare import tool_center
from taskspec.program.world import frames
from taskspec.spec import Task
from taskspec.stability.corners import MOST_AT_ONCE

_KEYS = ("stiffness", "xyz", "rpy")
#: A share of a quantity by which a varied value has to change it to be named.
_MATTERS = 1e-3


@dataclass(frozen=True, slots=True)
class ContactWorld:
    """One corner as a contact shows it.

    Attributes:
        values: of the components that vary.
        stiffness: of the contact [N/m].
        farther: how much farther from the tool its surface is than nominal [m].
    """

    values: Values
    stiffness: float
    farther: float = 0.0


def worlds(context: Context, name: str) -> Iterator[ContactWorld]:
    """The corners of `vary` about the truth for contact `name`, the world of the file first.

    All corners up to `MOST_AT_ONCE` components, beyond that one component at a time.
    """
    nominal = ContactWorld({}, _stiffness(context, context.loaded.task, name))
    yield nominal
    parts = list(_ends(context, name))
    keys = [f"world.{name}.{key}" for key in _KEYS]
    if not parts and (true := otherwise(context, lambda path: path in keys)):
        yield _world(context, name, true)
    if len(parts) <= MOST_AT_ONCE:
        chosen = itertools.product(*parts) if parts else ()
        corners = [dict(values) for values in chosen]
    else:
        corners = [dict([value]) for part in parts for value in part]
    yield from (_world(context, name, values) for values in corners)


def extreme(
    context: Context,
    name: str,
    quantity: Callable[[ContactWorld], float],
    size: Callable[[float], float],
) -> Extreme | None:
    """The world in which `size` of a quantity is largest; None where none changes it.

    Args:
        context: the task.
        name: of the contact.
        quantity: in a world [SI].
        size: how bad a value is.
    """
    nominal, *others = worlds(context, name)
    if not others:
        return None
    now = quantity(nominal)
    worst = max(others, key=lambda world: size(quantity(world)))
    value = quantity(worst)
    scale = max(abs(now), abs(value))
    if size(value) - size(now) <= _MATTERS * scale:
        return None
    return Extreme(value, _decisive(context, name, quantity, worst, _MATTERS * scale))


def _decisive(
    context: Context,
    name: str,
    quantity: Callable[[ContactWorld], float],
    worst: ContactWorld,
    slack: float,
) -> Values:
    """The values of a world without those that make no difference."""
    values, wanted = dict(worst.values), quantity(worst)
    for part in worst.values:
        rest = {key: value for key, value in values.items() if key != part}
        if rest and abs(quantity(_world(context, name, rest)) - wanted) <= slack:
            values = rest
    return values


def _ends(context: Context, name: str) -> Iterator[list[tuple[tuple[str, int | None], float]]]:
    """The two ends of each component that varies."""
    for key in _KEYS:
        path = f"world.{name}.{key}"
        components = context.loaded.task.vary.get(path, ())
        for i, variation in enumerate(components):
            if variation is None:
                continue
            part = (path, i if len(components) > 1 else None)
            yield [(part, end) for end in ends(context, *part, variation)]


def _world(context: Context, name: str, values: Values) -> ContactWorld:
    task = context.loaded.true_task
    for (path, index), value in values.items():
        task = changed(task, path, index, value)
    return ContactWorld(values, _stiffness(context, task, name), _farther(context, task, name))


def _stiffness(context: Context, task: Task, name: str) -> float:
    """Of the contact [N/m, N m/rad]: the nominal one, unless `vary` or `truth` has it."""
    if f"world.{name}.stiffness" in (*task.vary, *task.true_numbers):
        true = getattr(task.world[name], "stiffness", "rigid")
        if true != "rigid":
            return float(true)
    return context.compliances[name].stiffness


def _farther(context: Context, task: Task, name: str) -> float:
    if name not in context.surfaces:
        return 0.0
    center = ca.SX(ca.DM(tool_center(context)))
    nominal, true = (frames.surface(t.shapes[name]) for t in (context.loaded.task, task))
    return float(ca.evalf(true.distance(center) - nominal.distance(center)))
