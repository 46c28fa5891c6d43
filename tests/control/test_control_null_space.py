"""Goals in the null space: their gradients and potentials, and what the task feels of them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from arms import MovingArm
from taskspec.control import null_space
from taskspec.control.state import AXES

H = 1e-5


def arm_with_slides():
    """Hinges and slides in turn, all axes askew: seven joints, as Pinocchio builds them."""
    rng = np.random.default_rng(3)
    model = pin.Model()
    joint, kinds = 0, "RPRRPRR"
    for i, kind in enumerate(kinds):
        axis = rng.normal(size=3)
        make = pin.JointModelRevoluteUnaligned if kind == "R" else pin.JointModelPrismaticUnaligned
        placement = pin.SE3(pin.exp3(rng.normal(size=3)), rng.uniform(-0.3, 0.3, 3))
        joint = model.addJoint(joint, make(axis / np.linalg.norm(axis)), placement, f"j{i}")
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    return model, joint, pin.SE3(np.eye(3), np.array([0.05, 0.1, 0.2])), [k == "R" for k in kinds]


def panda():
    robot = MovingArm("panda", 0).robot
    return robot.pin, robot.tip_joint, robot.tip, [True] * 7


def jacobian(model, joint, tip, q):
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    J = np.array(data.J)
    J[:3] -= pin.skew((data.oMi[joint] * tip).translation) @ J[3:]
    return J


def log_w(J, axes, units):
    """ln w by NumPy, with the lengths that the module states."""
    rows = [AXES.index(a) for a in axes]
    scaled = np.array([0.3 if a.startswith("r") else 1.0 for a in axes])[:, None] * J[rows] * units
    A = scaled @ scaled.T + null_space.LEAST**2 * np.eye(len(axes))
    return 0.5 * np.linalg.slogdet(A)[1]


@pytest.mark.parametrize("arm", [panda, arm_with_slides])
@pytest.mark.parametrize("axes", [AXES, AXES[:3], ("x", "y", "rz")], ids=" ".join)
def test_the_gradient_of_manipulability_is_that_of_finite_differences(arm, axes):
    """From columns of J alone; ln w is of order 1, so 1e-6 is far above H^2 and 1e-16 / H."""
    model, joint, tip, turns = arm()
    units = null_space.joint_units(turns)
    symbol = ca.SX.sym("J", 6, 7)
    gradient = ca.Function("g", [symbol], [null_space.log_gradient(symbol, axes, units)])
    rng = np.random.default_rng(1)
    for _ in range(50):
        q = rng.uniform(-1.2, 1.2, 7)
        found = np.array(gradient(jacobian(model, joint, tip, q))).ravel()
        expected = np.zeros(7)
        for j in range(7):
            near = [
                log_w(jacobian(model, joint, tip, q + s * H * np.eye(7)[j]), axes, units)
                for s in (-1, 1)
            ]
            expected[j] = (near[1] - near[0]) / (2 * H)
        assert np.max(np.abs(found - expected)) < 1e-6 * max(1.0, np.max(np.abs(expected)))
