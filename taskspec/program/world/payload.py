"""The true mass of a tool: its own, and a payload unknown to the controller."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from taskspec.robot import RobotModel
from taskspec.robot.tool import make_tool
from taskspec.spec import Robot


def modelled_inertia(robot: RobotModel) -> pin.Inertia:
    """The modelled inertia of the tip's body, tip frame."""
    body = robot.tool_body
    axes = pin.Quaternion(*(float(x) for x in body.axes)).matrix()
    moments = axes @ np.diag(body.moments) @ axes.T
    return pin.Inertia(body.mass, body.lever, moments)


def differs(robot: RobotModel, declared: Robot) -> bool:
    """Whether the true tool has another mass or centre of mass than the model's, or a payload."""
    body, tool = robot.tool_body, declared.tool
    if tool.mass != body.mass or declared.payload is not None:
        return True
    if tool.com is None or not tool.mass:
        return False
    center = make_tool(tool, "z" not in robot.axes).inertia.lever
    return not np.array_equal(center, body.lever)


def true_inertia(robot: RobotModel, declared: Robot) -> pin.Inertia:
    """The true inertia of the tip's body, tip frame.

    Args:
        robot: the models that the controller has.
        declared: what is true of the arm.
    """
    modelled = modelled_inertia(robot)
    if not differs(robot, declared):
        return modelled
    inertia = make_tool(declared.tool, "z" not in robot.axes).inertia
    if declared.payload is not None:
        load = declared.payload
        inertia += pin.Inertia(load.mass, np.array(load.xyz), np.zeros((3, 3)))
    return inertia
