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

from taskspec.program.context import Context
from taskspec.program.world.stiffness import compliance, contact_mobility, creep
from taskspec.spec import Task
from taskspec.stability.plant import Rows
from taskspec.stability.points import Touched

Matrix = NDArray[np.float64]


def friction_rows(context: Context, task: Task, name: str, c: int, turns: Matrix) -> Rows:
    """Two dampers under the tool, along directions across the normal; one about a flat tool's.

    Under a tool of spheres there are two under each.

    Args:
        context: of the nominal task.
        task: whose world and robot are the true ones.
        name: of a shape that the tool touches.
        c: coordinates of the plant.
        turns: (3, k) about which the tool gives way.
    """
    robot, shape = context.robot, task.shapes[name]
    period = 1.0 / task.control.plant_rate
    touched = Touched(context, task, name)
    points = 1 if touched.whole else len(robot.tool.centers)
    damping = compliance(shape, robot, context.start, period).damping / points
    # Where friction is stiffer (`friction_ratio`) the tool does the same by less: it all but
    # stands, and would be said to ring, by less than a micrometre.
    force, mass = creep(damping, contact_mobility(robot, shape), period)
    G, W, levers = _across(
        context, touched, c, turns, lambda normal: np.linalg.svd(normal[None, :])[2][1:]
    )
    each = np.diag(levers**2)
    return _damper(name, G, W, force * each, mass * each)


def sliding_rows(
    context: Context,
    task: Task,
    name: str,
    force: float,
    c: int,
    velocity: Matrix,
    turns: Matrix,
) -> Rows:
    """One damper under the tool, or under each of its spheres, across its way.

    A flat tool has one more, about the normal.

    Args:
        context: of the nominal task.
        task: whose world and robot are the true ones.
        name: of a shape that the tool presses on.
        force: with which it does [N].
        c: coordinates of the plant.
        velocity: (3,) of the tool, world axes; not zero across the normal [m/s].
        turns: (3, k) about which the tool gives way.
    """

    def across(normal: Matrix) -> Matrix:
        way = np.cross(normal, velocity)
        return np.asarray(way / np.linalg.norm(way))[None, :]

    touched = Touched(context, task, name)
    G, W, levers = _across(context, touched, c, turns, across)
    points = 1 if touched.whole else len(G)
    share = task.shapes[name].friction * force / points
    B = share / float(np.linalg.norm(velocity)) * np.diag(levers**2)
    # The simulator has friction oppose the velocity at its step's end.
    return replace(_damper(name, G, W, B, B / task.control.plant_rate), rubs=True)


def _across(
    context: Context,
    touched: Touched,
    c: int,
    turns: Matrix,
    ways: Callable[[Matrix], Matrix],
) -> tuple[Matrix, Matrix, Matrix]:
    """G and W of directions (k, 3) across the normal, as `ways` has them, under every point.

    Third is how much a rate along each counts against a slip: 1, or of turning about the normal
    the lever with which the patch of a flat tool resists it [m].
    """
    robot, n, J = context.robot, context.robot.n, context.start_jacobian
    G, W, levers = [], [], []
    points = zip(robot.tool.centers, robot.tool.radii, strict=True)
    if touched.whole:
        patch = touched.laid(context.start_p, context.start_R, turns)
        places = [(patch.normal, patch.lever)]
    else:
        places = []
        for center, radius in points:
            lever = context.start_R @ center
            normal, _ = touched.normal_at(context.start_p + lever, float(radius))
            places.append((normal, lever - float(radius) * normal))
    for normal, lever in places:
        across = ways(normal)
        twists = np.hstack([across, np.cross(lever, across)])
        G.append(np.hstack([twists @ J, np.zeros((len(across), c - n))]))
        W.append(twists.T)
        levers += [1.0] * len(across)
        if touched.whole:
            about = np.concatenate([np.zeros(3), normal])[None, :]
            G.append(np.hstack([about @ J, np.zeros((1, c - n))]))
            W.append(about.T)
            levers.append(patch.spin)
    return np.vstack(G), np.hstack(W), np.array(levers)


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
