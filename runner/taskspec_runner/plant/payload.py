"""What a tool really weighs: its own mass, and what it carries without the controller's knowing."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin

from taskspec.robot.tool import make_tool
from taskspec_runner.plant.arm import SceneArm
from taskspec_runner.plant.names import quaternion


def weigh(spec: mujoco.MjSpec, arm: SceneArm) -> None:
    """Gives the tool's body its true mass and inertia, where they are not those of the model.

    A counterweight carries what the model has: the rest hangs on the arm.
    """
    declared, robot = arm.declared, arm.robot
    modelled = float(robot.model.body(robot.tip_body).mass[0])
    if declared.tool.mass == modelled and declared.payload is None:
        return
    inertia = make_tool(declared.tool, "z" not in robot.axes).inertia
    if declared.payload is not None:
        load = declared.payload
        inertia += pin.Inertia(load.mass, np.array(load.xyz), np.zeros((3, 3)))
    moments, axes = np.linalg.eigh(inertia.inertia)
    axes[:, 0] *= np.linalg.det(axes)
    body = spec.body(robot.tip_body)
    body.mass, body.ipos = inertia.mass, inertia.lever if inertia.mass else np.zeros(3)
    body.iquat, body.inertia = quaternion(axes), np.maximum(moments, 0.0)
    if body.gravcomp and inertia.mass:
        body.gravcomp *= modelled / inertia.mass
