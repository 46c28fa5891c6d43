"""Goals in the null space: their gradients and potentials, and what the task feels of them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from arms import MovingArm
from taskspec.control import null_space
from taskspec.geometry.axis import AXES, Axis

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
        link = pin.Inertia(2.0, rng.normal(size=3) / 10, 0.02 * np.eye(3))
        model.appendBodyToJoint(joint, link, pin.SE3.Identity())
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
@pytest.mark.parametrize("axes", [AXES, AXES[:3], (Axis.X, Axis.Y, Axis.RZ)], ids=" ".join)
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


LOWER, UPPER = np.array([-2.0, -0.4, 0.0, -np.inf]), np.array([2.0, 0.6, 0.5, np.inf])
#: Two hinges, a slide and a hinge without limits; widths by the stated 20 % and 0.5 rad.
UNITS = null_space.joint_units([True, True, False, True])
WIDTHS = np.array([0.5, 0.2, 0.1, 0.0])


def repulsion(q):
    symbol = ca.SX.sym("q", 4)
    pull = null_space.repulsion(symbol, LOWER, UPPER, UNITS)
    return np.array(ca.Function("r", [symbol], [pull])(q)).ravel()


def test_joint_limits_pull_near_the_limits_alone():
    np.testing.assert_allclose(null_space.widths(LOWER, UPPER, UNITS), WIDTHS, rtol=1e-14)
    assert np.all(repulsion([1.49, 0.1, 0.25, 50.0]) == 0)
    bounded = slice(0, 3)
    for part in (0.0, 0.25, 0.5, 1.0):
        low = repulsion(np.where(WIDTHS > 0, LOWER + part * WIDTHS, 0.0))
        high = repulsion(np.where(WIDTHS > 0, UPPER - part * WIDTHS, 0.0))
        expected = WIDTHS * (1 - part) ** 2
        np.testing.assert_allclose(low, expected, atol=1e-15)
        np.testing.assert_allclose(high, -expected, atol=1e-15)
        if part:
            # From inside and outside of the width: the slope is 2 s, without a step.
            slope = [
                (repulsion(LOWER + part * WIDTHS + H) - repulsion(LOWER + part * WIDTHS - H))
                / (2 * H)
            ]
            np.testing.assert_allclose(slope[0][bounded], -2 * (1 - part), atol=1e-4)


def test_the_pull_damps_critically():
    pull, v = np.array([0.3, -0.1]), np.array([1.0, 2.0])
    found = null_space.acceleration(ca.SX(ca.DM(pull)), ca.SX(ca.DM(v)))
    w = 4 * np.pi
    np.testing.assert_allclose(np.array(ca.evalf(found)).ravel(), w**2 * pull - 2 * w * v)


@pytest.mark.parametrize("arm", [panda, arm_with_slides])
def test_pulls_lie_in_the_null_space_and_rise_along_it(arm):
    """J pull = 0 to the regularisation, and the projector weighted with H cannot turn it round."""
    model, joint, tip, turns = arm()
    units = null_space.joint_units(turns)
    jac, raw = ca.SX.sym("J", 6, 7), ca.SX.sym("r", 7)
    task = null_space.scale(jac, AXES, units)
    pulls = ca.Function(
        "p",
        [jac, raw],
        [
            null_space.manipulability(jac, AXES, task, units),
            null_space.log_gradient(jac, AXES, units),
            units * null_space.along_null_space(raw / units, task),
        ],
    )
    data = model.createData()
    rng = np.random.default_rng(2)
    turned = 0
    for _ in range(300):
        q, single = rng.uniform(-1.2, 1.2, 7), np.zeros(7)
        single[rng.integers(7)] = 0.1
        J = jacobian(model, joint, tip, q)
        upper = np.triu(pin.crba(model, data, q))
        inertia = upper + np.triu(upper, 1).T
        inverse = np.linalg.inv(inertia)
        projector = np.eye(7) - inverse @ J.T @ np.linalg.inv(J @ inverse @ J.T) @ J
        found = [np.array(p).ravel() for p in pulls(J, single)]
        assert np.linalg.norm(found[0] / units) <= null_space.MOST
        rows = np.array([1.0, 1.0, 1.0, 0.3, 0.3, 0.3])[:, None] * J * units
        rest = (null_space.NONE / np.linalg.svd(rows)[1][-1]) ** 2
        for pull, gradient in ((found[0], found[1]), (found[2], single / units**2)):
            assert gradient @ pull >= 0
            # J P g = NONE^2 (J J^T + NONE^2 I)^-1 J g; double precision on rows of length 1.
            most = rest * np.linalg.norm(rows @ (units * gradient)) + 1e-13
            assert np.linalg.norm(rows @ (pull / units)) <= most
        turned += (projector @ (units**2 * found[1])) @ found[1] < 0
    # Without laying it into the null space first, w would often fall.
    assert turned > 30
