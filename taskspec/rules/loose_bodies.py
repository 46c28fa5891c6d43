"""Loose bodies as the run begins: those that lie inside of other objects are thrown out."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.program.context import Context
from taskspec.program.plan import TaskPlan
from taskspec.rules import Finding, Phase, rule, warning
from taskspec.shapes import BoundedSurface, Surface
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
        points, radius = _points(context.surfaces[name])
        for other in shapes:
            pair = frozenset((name, other))
            if other == name or pair in reported:
                continue
            depth = radius - min(_distance(context, other, point) for point in points)
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


def _points(body: Surface) -> tuple[NDArray[np.float64], float]:
    """World points (k, 3) that a body reaches furthest with [m], and a radius about them."""
    assert isinstance(body, BoundedSurface)
    own, radius = body.extremes()
    return body.origin + own @ body.rotation.T, radius


def _distance(context: Context, name: str, point: NDArray[np.float64]) -> float:
    """Signed distance [m] of a world point (3,) from an object as the run begins."""
    base = context.moving_bases.get(name)
    if base is not None:
        A, a = base.pose(0.0)
        point = A.T @ (point - a)
    return float(ca.evalf(context.surfaces[name].distance(ca.SX(point))))
