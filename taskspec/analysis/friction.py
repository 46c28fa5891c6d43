"""Friction below its limit: what holds a tool that does not slide.

Coulomb's friction has no derivative. While a tool slides, its size stays and it is left out. While
a tool sticks, the plant's friction is a damper across the normal, which lets the tool creep, with
the mass that the simulator's constraint adds. It is stiff, and what a late sensor makes of it is
taken off the motion axes too late.
"""

from __future__ import annotations

import numpy as np

from taskspec.analysis.plant import Rows
from taskspec.analysis.points import Touched, skew
from taskspec.program.context import Context
from taskspec.program.world.stiffness import compliance, contact_mobility, creep
from taskspec.spec import Task


def friction_rows(context: Context, task: Task, name: str, c: int) -> Rows:
    """Two dampers under every sphere of the tool, along directions across the normal.

    Args:
        context: of the nominal task.
        task: whose world and robot are the true ones.
        name: of a shape that the tool touches.
        c: coordinates of the plant.
    """
    robot, n, shape = context.robot, context.robot.pin.nv, task.shapes[name]
    period = 1.0 / task.control.plant_rate
    points = len(robot.tool.centers)
    damping = compliance(shape, robot, context.start, period).damping / points
    mobility = contact_mobility(robot, shape)
    force, mass = creep(damping, mobility, period)
    r = 2 * points
    G, W = np.zeros((r, c)), np.zeros((6, r))
    touched = Touched(context, task, name)
    for i, (center, radius) in enumerate(zip(robot.tool.centers, robot.tool.radii, strict=True)):
        lever = context.start_R @ center
        normal, _ = touched.normal_at(context.start_p + lever, float(radius))
        lever = lever - float(radius) * normal
        at = context.start_jacobian[:3] - skew(lever) @ context.start_jacobian[3:]
        across = np.linalg.svd(normal[None, :])[2][1:]
        rows = slice(2 * i, 2 * i + 2)
        G[rows, :n] = across @ at
        W[:3, rows], W[3:, rows] = across.T, np.cross(lever, across).T
    each = np.eye(r)
    return Rows(
        name=name,
        G=G,
        W=W,
        K=np.zeros((r, r)),
        B=force * each,
        M=mass * each,
        turning=np.zeros((6, c)),
        bending=np.zeros((c, c)),
    )
