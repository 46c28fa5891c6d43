"""The wrist: contact, weight and inertia of the tool, against the tool's Newton-Euler."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from plants import Pushed
from taskspec.robot.tool import make_tool

TABLE = "table: {shape: plane, xyz: [0, 0, 399 mm], stiffness: 20 kN/m, friction: 0.2}"
TOOL = "tool: {shape: box, size: [60 mm, 30 mm, 20 mm], length: 120 mm, mass: 800 g}"


SANDER = (
    "tool: {shape: cylinder, radius: 30 mm, thickness: 15 mm, length: 120 mm, mass: 800 g, "
    "com: [10 mm, 60 mm, 50 mm], "
    "inertia: [3e-3 kg*m^2, 2e-3 kg*m^2, 2.5e-3 kg*m^2, 4e-4 kg*m^2, 0, -2e-4 kg*m^2]}"
)


def wrist(world: str, damping: float = 0.0, tool: str = TOOL) -> Pushed:
    return Pushed(world, f"{tool}, sensor: {{at: wrist}}", damping=damping)


def inertia(pushed: Pushed) -> pin.Inertia:
    """Of the tool about its tip, in the tip's axes."""
    return make_tool(pushed.task.robot.tool, planar=False).inertia


@pytest.mark.parametrize("tool", [TOOL, SANDER])
def test_at_rest_it_shows_the_tools_weight(tool):
    pushed = wrist("", damping=20.0, tool=tool)
    pushed.push(0.0, 0.2)
    R = pushed.data.xmat[pushed.body].reshape(3, 3)
    weight = np.array([0.0, 0.0, -0.8 * 9.81])
    np.testing.assert_allclose(pushed.plant.arm.wrist[:3], weight, atol=1e-9)
    lever = R @ inertia(pushed).lever
    np.testing.assert_allclose(pushed.plant.arm.wrist[3:], np.cross(lever, weight), atol=1e-9)


@pytest.mark.parametrize("damping", [0.0, 1.0, 20.0])
@pytest.mark.parametrize("tool", [TOOL, SANDER])
def test_in_motion_it_shows_weight_and_inertia(tool, damping):
    """Against Pinocchio's force of the tool alone, with the change of velocity in the step.

    MuJoCo's own q'' leaves out that its step takes the damping of joints at its end.
    """
    pushed = wrist("", damping=damping, tool=tool)
    pushed.push([3.0, -5.0, 4.0, 0.4, 0.3, -0.2], 0.1)
    robot, before = pushed.robot, (pushed.plant.arm.q.copy(), pushed.plant.arm.v.copy())
    pushed.push([3.0, -5.0, 4.0, 0.4, 0.3, -0.2], 1e-3)
    data = robot.pin.createData()
    acceleration = (pushed.plant.arm.v - before[1]) / pushed.model.opt.timestep
    given = np.abs(acceleration - pushed.data.qacc[:7]).max()
    assert given < 1e-9 if damping == 0 else given > 0.01
    pin.forwardKinematics(robot.pin, data, *before, acceleration)
    tip, joint = robot.tip, robot.tip_joint
    pose = data.oMi[joint] * tip
    twist, rate = tip.actInv(data.v[joint]), tip.actInv(data.a[joint])
    gravity = pin.Motion(pose.rotation.T @ [0, 0, -9.81], np.zeros(3))
    Y = inertia(pushed)
    force = Y * (rate - gravity) + twist.cross(Y * twist)
    expected = -np.concatenate([pose.rotation @ force.linear, pose.rotation @ force.angular])
    assert np.linalg.norm(expected[:3] - [0, 0, -0.8 * 9.81]) > (1.0 if damping < 20 else 0.1)
    np.testing.assert_allclose(pushed.plant.arm.wrist, expected, atol=1e-9)


def test_contact_is_added():
    pushed = wrist(TABLE, damping=20.0)
    pushed.push([5.0, 0, -30.0], 3.0, spring=500.0)
    assert pushed.plant.arm.wrench[2] > 5.0
    R = pushed.data.xmat[pushed.body].reshape(3, 3)
    weight = np.array([0.0, 0.0, -0.8 * 9.81])
    tool = np.concatenate([weight, np.cross(R @ inertia(pushed).lever, weight)])
    np.testing.assert_allclose(pushed.plant.arm.wrist, pushed.plant.arm.wrench + tool, atol=1e-3)


def test_reading_it_changes_nothing():
    felt, plain = wrist(TABLE), Pushed(TABLE, TOOL)
    for pushed in (felt, plain):
        pushed.push([0, 0, -30.0], 0.05)
    np.testing.assert_array_equal(felt.plant.arm.q, plain.plant.arm.q)
    np.testing.assert_array_equal(felt.plant.arm.wrench, plain.plant.arm.wrench)
    assert plain.plant.arm.wrist is None
    with pytest.raises(KeyError):
        mujoco.MjModel.sensor(plain.model, plain.plant.scene.arm.element("wrist/linear"))
