"""The tool's body with what it really weighs."""

from __future__ import annotations

import mujoco
import numpy as np

from taskspec.program.world.payload import differs, true_inertia
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.names import quaternion


def weigh(spec: mujoco.MjSpec, arm: SceneArm) -> float:
    """Gives the tool's body its true mass and inertia, where they are not those of the model.

    A counterweight carries what the model has: the rest hangs on the arm.

    Args:
        spec: with the arm alone.
        arm: it.

    Returns:
        The tool's mobility as MuJoCo counts it in contacts, its translational `invweight0` [1/kg].
    """
    declared, robot = arm.declared, arm.robot
    modelled = float(robot.model.body(robot.tip_body).mass[0])
    if not differs(robot, declared):
        return robot.tool_body.mobility
    inertia = true_inertia(robot, declared)
    moments, axes = np.linalg.eigh(inertia.inertia)
    axes[:, 0] *= np.linalg.det(axes)
    body = spec.body(robot.tip_body)
    body.mass, body.ipos = inertia.mass, inertia.lever if inertia.mass else np.zeros(3)
    body.iquat, body.inertia = quaternion(axes), np.maximum(moments, 0.0)
    if body.gravcomp and inertia.mass:
        body.gravcomp *= modelled / inertia.mass
    return float(spec.compile().body(robot.tip_body).invweight0[0])
