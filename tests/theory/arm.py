"""What a run's plant is made of, read from MuJoCo: the mass that is felt, and the contact."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from sampled import Loop

from taskspec.geometry.axis import AXES
from taskspec.program.world.stiffness import IMPEDANCE
from taskspec_runner.plant.plant import Plant

Vector = NDArray[np.float64]


def joint_columns(run: Any, what: str) -> Vector:
    """(ticks, n) a signal of all joints."""
    n = run.program.context.robot.pin.nv
    return np.column_stack([run[f"joint.{i + 1}.{what}"] for i in range(n)])


def joints(run: Any, row: int, what: str = "position") -> Vector:
    """(n,) joint positions [rad], velocities [rad/s] or torques [N m] of a row of the log."""
    n = run.program.context.robot.pin.nv
    return np.array([run[f"joint.{i + 1}.{what}"][row] for i in range(n)])


def inertia_and_jacobian(run: Any, q: Vector) -> tuple[Vector, Vector]:
    """H (n, n) and the tip's J (6, n), world axes, at q (n,), by MuJoCo."""
    context = run.program.context
    plant = Plant(context.robot, context.loaded.task, context.start)
    model, data, n = plant.model, plant.data, len(q)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    H, J = np.zeros((n, n)), np.zeros((6, n))
    mujoco.mj_fullM(model, data, H)
    body = data.body(context.robot.tip_body)
    mujoco.mj_jac(model, data, J[:3], J[3:], body.xpos, body.id)
    return H, J


def loop(run: Any, axes: str, normal: str, row: int = 0) -> Loop:
    """The arm and its first object as the sampled model has them, at a row of the log.

    Args:
        run: the run. axes: task axes in the world, such as "x y". normal: one of them.
        row: where the run is looked at.
    """
    names = axes.split()
    H, J = inertia_and_jacobian(run, joints(run, row))
    J = J[[AXES.index(a) for a in names]]
    context = run.program.context
    plant = Plant(context.robot, context.loaded.task, context.start)
    A = float(plant.model.body(context.robot.tip_body).invweight0[0])
    control = context.loaded.task.control
    contact = next(iter(context.compliances.values()), None)
    return Loop(
        inertia=np.linalg.inv(J @ np.linalg.solve(H, J.T)),
        normal=names.index(normal),
        k=contact.stiffness if contact else 0.0,
        b=contact.damping if contact else 0.0,
        # docs/conventions.md, Contact: 2 % of the mean mass that a contact at the tool feels.
        virtual=IMPEDANCE / (1 - IMPEDANCE) / A if contact else 0.0,
        period=1.0 / control.rate,
        steps=round(control.plant_rate / control.rate),
    )
