"""Loose bodies as the run begins: those that lie inside of other objects are thrown out."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.held_part import distance
from taskspec.program.plan import TaskPlan
from taskspec.rules import Finding, Phase, rule, warning
from taskspec.spec import FILE, key_of
from taskspec.text.units import show

_GRAVITY = 9.81
#: A contact that pushes with this many times a body's weight lifts it off.
_LIFTS = 2.0


@rule({}, also=("TS305",), phase=Phase.TASK)
def thrown_bodies(task: TaskPlan) -> Iterator[Finding]:
    """Loose bodies that begin so deep in another object that it throws them."""
    context, shapes = task.context, task.context.loaded.task.shapes
    reported: set[frozenset[str]] = set()
    for name, body in shapes.items():
        if not body.free or body.mass is None:
            continue
        for other in shapes:
            pair = frozenset((name, other))
            if other == name or pair in reported:
                continue
            depth = -distance(context, name, other)
            stiffness = context.compliances[other].stiffness
            if shapes[other].free:
                stiffness = min(stiffness, context.compliances[name].stiffness)
            if depth * stiffness > _LIFTS * body.mass * _GRAVITY:
                reported.add(pair)
                yield warning(
                    "TS305",
                    f"{name!r} starts {show(depth, 'mm', 3)} inside {other!r}: the run begins with "
                    f"{show(depth * stiffness, 'N', 3)} between them",
                    key_of(FILE.world[name]),
                    "let the body lie on it: the contact gives way by weight / stiffness",
                )
