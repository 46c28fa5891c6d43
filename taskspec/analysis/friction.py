"""Coulomb's friction about an equilibrium: what holds a tool that does not slide, or slides ahead.

While a tool sticks, the plant's friction is a damper across the normal, which lets the tool creep,
with the mass that the simulator's constraint adds. It is stiff, and what a late sensor makes of it
is taken off the motion axes too late.

While a tool slides with the velocity v, friction is -mu f v/|v|. Along v its size stays. Across v,
and across the normal, it turns with the velocity: there it is a damper of mu f/|v|.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from taskspec.analysis.plant import Rows
from taskspec.analysis.points import Touched, skew
from taskspec.program.context import Context
from taskspec.program.world.stiffness import compliance, contact_mobility, creep
from taskspec.spec import Task

Matrix = NDArray[np.float64]


def friction_rows(context: Context, task: Task, name: str, c: int) -> Rows:
    """Two dampers under every sphere of the tool, along directions across the normal.

    Args:
        context: of the nominal task.
        task: whose world and robot are the true ones.
        name: of a shape that the tool touches.
        c: coordinates of the plant.
    """
    robot, shape = context.robot, task.shapes[name]
    period = 1.0 / task.control.plant_rate
    points = len(robot.tool.centers)
    damping = compliance(shape, robot, context.start, period).damping / points
    # Where friction is stiffer (`friction_ratio`) the tool does the same by less: it all but
    # stands, and would be said to ring, by less than a micrometre.
    force, mass = creep(damping, contact_mobility(robot, shape), period)
    G, W = _across(context, task, name, c, lambda normal: np.linalg.svd(normal[None, :])[2][1:])
    each = np.eye(len(G))
    return _damper(name, G, W, force * each, mass * each)


def sliding_rows(
    context: Context, task: Task, name: str, force: float, c: int, velocity: Matrix
) -> Rows:
    """One damper under every sphere of the tool, across its way.

    Args:
        context: of the nominal task.
        task: whose world and robot are the true ones.
        name: of a shape that the tool presses on.
        force: with which it does [N].
        c: coordinates of the plant.
        velocity: (3,) of the tool, world axes; not zero across the normal [m/s].
    """

    def across(normal: Matrix) -> Matrix:
        way = np.cross(normal, velocity)
        return np.asarray(way / np.linalg.norm(way))[None, :]

    G, W = _across(context, task, name, c, across)
    share = task.shapes[name].friction * force / len(G)
    B = share / float(np.linalg.norm(velocity)) * np.eye(len(G))
    # The simulator has friction oppose the velocity at its step's end.
    return replace(_damper(name, G, W, B, B / task.control.plant_rate), rubs=True)


def _across(
    context: Context, task: Task, name: str, c: int, ways: Callable[[Matrix], Matrix]
) -> tuple[Matrix, Matrix]:
    """G and W of directions (k, 3) across the normal, as `ways` has them, under every sphere."""
    robot, n = context.robot, context.robot.pin.nv
    G, W, touched = [], [], Touched(context, task, name)
    for center, radius in zip(robot.tool.centers, robot.tool.radii, strict=True):
        lever = context.start_R @ center
        normal, _ = touched.normal_at(context.start_p + lever, float(radius))
        lever = lever - float(radius) * normal
        at = context.start_jacobian[:3] - skew(lever) @ context.start_jacobian[3:]
        across = ways(normal)
        G.append(np.hstack([across @ at, np.zeros((len(across), c - n))]))
        W.append(np.vstack([across.T, np.cross(lever, across).T]))
    return np.vstack(G), np.hstack(W)


def _damper(name: str, G: Matrix, W: Matrix, B: Matrix, M: Matrix) -> Rows:
    c = G.shape[1]
    return Rows(
        name=name,
        G=G,
        W=W,
        K=np.zeros_like(B),
        B=B,
        M=M,
        turning=np.zeros((6, c)),
        bending=np.zeros((c, c)),
    )
