"""The tool's body with what it really weighs."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin

from taskspec.robot import RobotModel
from taskspec.robot.poses import principal_axes
from taskspec.robot.tool import make_tool
from taskspec.spec import Robot
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
    robot = arm.robot
    inertia = _true_inertia(robot, arm.declared)
    if inertia is None:
        return robot.tool_body.mobility
    moments, axes = principal_axes(inertia.inertia)
    body = spec.body(robot.tip_body)
    body.mass, body.ipos = inertia.mass, inertia.lever if inertia.mass else np.zeros(3)
    body.iquat, body.inertia = quaternion(axes), np.maximum(moments, 0.0)
    if body.gravcomp and inertia.mass:
        body.gravcomp *= robot.tool_body.mass / inertia.mass
    return float(spec.compile().body(robot.tip_body).invweight0[0])


def _true_inertia(robot: RobotModel, declared: Robot) -> pin.Inertia | None:
    """The true inertia of the tip's body with what it carries, tip frame; None for the model's.

    Args:
        robot: the models that the controller has.
        declared: what is true of the arm.
    """
    body, tool, load = robot.tool_body, declared.tool, declared.payload
    weighs = tool.mass == body.mass and load is None
    if weighs and (tool.com is None or not tool.mass):
        return None
    inertia = make_tool(tool, "z" not in robot.axes).inertia
    if weighs and np.array_equal(inertia.lever, body.lever):
        return None
    if load is not None:
        inertia += pin.Inertia(load.mass, np.array(load.xyz), np.zeros((3, 3)))
    return inertia
