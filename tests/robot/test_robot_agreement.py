"""MuJoCo and Pinocchio hold the same arm, whatever it was made from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from taskspec.robot import RobotModel

TOLERANCE = 1e-10
STATES = 20

CASES = {
    "planar2": {"model": "planar2"},
    "planar3": {"model": "planar3"},
    "planar2, tilted": {"model": "planar2", "base_rpy": (np.pi / 2, 0.0, 0.0)},
    "ur5e": {"model": "ur5e"},
    "panda": {"model": "panda"},
    "panda, mounted": {
        "model": "panda", "base_xyz": (0.2, -0.4, 0.7), "base_rpy": (0.3, -1.2, 2.0),
    },
    "panda, box tool": {
        "model": "panda", "tool_shape": "box", "tool_size": (0.06, 0.04, 0.02), "tool_length": 0.15,
    },
    "URDF": {"model": "own.urdf", "flange": "palm"},
    "URDF, mounted": {
        "model": "own.urdf", "flange": "palm", "base_xyz": (1, 2, 3), "base_rpy": (0.1, 0.2, 3),
    },
    "MJCF, a site": {"model": "own.xml", "flange": "grip"},
    "MJCF, a frame": {"model": "own.xml", "flange": "tool_frame", "base_rpy": (3.0, 0.5, -1.0)},
    "MJCF, a body in between": {"model": "own.xml", "flange": "three"},
}  # fmt: skip


@pytest.fixture(params=CASES)
def robot(request: pytest.FixtureRequest, load: Callable[..., RobotModel]) -> RobotModel:
    return load(**CASES[request.param])


class Twins:
    """Both engines at one state."""

    def __init__(self, robot: RobotModel, q: np.ndarray, v: np.ndarray) -> None:
        m = robot.model
        self.robot, self.m, self.d = robot, m, mujoco.MjData(m)
        self.d.qpos[:], self.d.qvel[:] = q, v
        mujoco.mj_forward(m, self.d)
        self.pin, self.data = robot.pin, robot.pin.createData()
        pin.computeAllTerms(self.pin, self.data, q, v)
        pin.updateFramePlacements(self.pin, self.data)
        self.q, self.v = q, v
        self.frame = self.pin.getFrameId("tip")
        self.body = m.body(robot.tip_body).id


@pytest.fixture
def states(robot: RobotModel) -> list[Twins]:
    def draw() -> Iterator[Twins]:
        rng = np.random.default_rng(1)
        for _ in range(STATES):
            q = rng.uniform(np.maximum(robot.lower, -3), np.minimum(robot.upper, 3))
            yield Twins(robot, q, rng.normal(size=q.size))

    return list(draw())


def test_configurations_have_the_same_meaning(robot: RobotModel) -> None:
    assert robot.pin.nq == robot.model.nq == robot.home.size
    assert tuple(robot.pin.names)[1:] == robot.joint_names
    assert [robot.model.joint(i).name for i in range(robot.model.njnt)] == list(robot.joint_names)
    assert [robot.model.actuator(i).name for i in range(robot.model.nu)] == list(robot.joint_names)
    np.testing.assert_array_equal(robot.pin.gravity.linear, [0, 0, -9.81])


def test_inertia_matrix(states: list[Twins]) -> None:
    for s in states:
        H = np.zeros((s.m.nv, s.m.nv))
        mujoco.mj_fullM(s.m, s.d, H)
        upper = np.triu(s.data.M)
        np.testing.assert_allclose(upper + np.triu(upper, 1).T, H, rtol=0, atol=TOLERANCE)


def test_bias_forces(states: list[Twins]) -> None:
    for s in states:
        np.testing.assert_allclose(s.data.nle, s.d.qfrc_bias, rtol=0, atol=TOLERANCE)


def test_gravity(states: list[Twins]) -> None:
    for s in states:
        s.d.qvel[:] = 0
        mujoco.mj_forward(s.m, s.d)
        g = pin.computeGeneralizedGravity(s.pin, s.data, s.q)
        np.testing.assert_allclose(g, s.d.qfrc_bias, rtol=0, atol=TOLERANCE)


def test_no_passive_forces(states: list[Twins]) -> None:
    for s in states:
        np.testing.assert_array_equal(s.d.qfrc_passive, 0)


def test_pose_of_the_tip(states: list[Twins]) -> None:
    for s in states:
        tip = s.data.oMi[s.robot.tip_joint] * s.robot.tip
        assert tip.isApprox(s.data.oMf[s.frame], 1e-12)
        np.testing.assert_allclose(tip.translation, s.d.xpos[s.body], rtol=0, atol=TOLERANCE)
        np.testing.assert_allclose(
            tip.rotation, s.d.xmat[s.body].reshape(3, 3), rtol=0, atol=TOLERANCE
        )


def test_jacobian_of_the_tip(states: list[Twins]) -> None:
    for s in states:
        J = np.zeros((6, s.m.nv))
        mujoco.mj_jac(s.m, s.d, J[:3], J[3:], s.d.xpos[s.body], s.body)
        twin = pin.getFrameJacobian(s.pin, s.data, s.frame, pin.LOCAL_WORLD_ALIGNED)
        np.testing.assert_allclose(twin, J, rtol=0, atol=TOLERANCE)


def test_drift_of_the_tip(states: list[Twins]) -> None:
    for s in states:
        dJ = np.zeros((6, s.m.nv))
        mujoco.mj_jacDot(s.m, s.d, dJ[:3], dJ[3:], s.d.xpos[s.body], s.body)
        pin.forwardKinematics(s.pin, s.data, s.q, s.v, np.zeros(s.pin.nv))
        drift = pin.getFrameClassicalAcceleration(
            s.pin, s.data, s.frame, pin.LOCAL_WORLD_ALIGNED
        ).vector
        np.testing.assert_allclose(drift, dJ @ s.v, rtol=0, atol=TOLERANCE)


def test_acceleration_under_torque(states: list[Twins]) -> None:
    for s in states:
        s.d.ctrl[:] = np.linspace(-1, 1, s.m.nu)
        mujoco.mj_forward(s.m, s.d)
        np.testing.assert_allclose(s.d.qfrc_actuator, s.d.ctrl, rtol=0, atol=0)
        free = pin.aba(s.pin, s.data, s.q, s.v, np.array(s.d.ctrl))
        np.testing.assert_allclose(s.d.qacc_smooth, free, rtol=1e-9, atol=1e-8)


def test_pinocchios_own_urdf_parser_has_the_same_arm(
    load: Callable[..., RobotModel], data: Path
) -> None:
    """A second opinion on the way through MuJoCo, where Pinocchio reads the file itself."""
    robot = load("own.urdf", flange="palm", tool_mass=0.0, tool_length=0.0)
    whole = pin.buildModelFromUrdf(str(data / "own.urdf"))
    fingers = [whole.getJointId("left"), whole.getJointId("right")]
    there = pin.neutral(whole)
    for joint in fingers:
        there[whole.idx_qs[joint]] = 0.025
    other = pin.buildReducedModel(whole, fingers, there)
    rng = np.random.default_rng(3)
    ours, theirs = robot.pin.createData(), other.createData()
    for _ in range(STATES):
        q, v = rng.uniform(-2, 2, 6), rng.normal(size=6)
        # A continuous joint is a point on the circle there.
        circle = np.concatenate((q[:3], [np.cos(q[3]), np.sin(q[3])], q[4:]))
        pin.computeAllTerms(robot.pin, ours, q, v)
        pin.computeAllTerms(other, theirs, circle, v)
        pin.updateFramePlacements(other, theirs)
        np.testing.assert_allclose(np.triu(ours.M), np.triu(theirs.M), rtol=0, atol=TOLERANCE)
        np.testing.assert_allclose(ours.nle, theirs.nle, rtol=0, atol=TOLERANCE)
        tip = ours.oMi[robot.tip_joint] * robot.tip
        assert tip.isApprox(theirs.oMf[other.getFrameId("palm")], TOLERANCE)
