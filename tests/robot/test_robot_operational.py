"""Terms of operational space, held against the arm's own equation of motion."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from taskspec.robot import RobotModel
from taskspec.robot.operational import SingularPoseError, operational_terms

Load = Callable[..., RobotModel]

ARMS = {
    "ur5e": [0.3, -1.2, 1.4, -1.1, -1.3, 0.4],
    "panda": [0.2, -0.4, 0.3, -2.1, 0.2, 1.7, 0.5],
    "planar2": [0.4, 1.1],
    "planar3": [0.4, 0.7, 0.6],
    "palletizer.urdf": [0.3, 0.4, 0.6, 0.2],
}


def acceleration(robot: RobotModel, q: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """q'' of H q'' + C q' + g = u, by the torques at rest and at unit accelerations."""
    twin, none = robot.twin(), np.zeros(robot.n)
    bias = twin.torque(q, v, none)
    return np.linalg.solve(twin.inertia(q), u - bias)


@pytest.mark.parametrize("name", ARMS)
def test_the_equation_of_motion_at_the_tool(load: Load, name: str) -> None:
    """(4.8) of what moves without a motion of the null space: torques J^T F, rates J_# x'."""
    robot, rng = load(name), np.random.default_rng(4)
    q = np.array(ARMS[name])
    twin, rows = robot.twin(), [axis.row for axis in robot.axes]
    terms = operational_terms(twin, robot.axes, q)
    J = twin.jacobian(q)[rows]
    inverse = np.linalg.solve(twin.inertia(q), J.T) @ terms.inertia
    np.testing.assert_allclose(J @ inverse, np.eye(len(rows)), atol=1e-9)
    for _ in range(5):
        rate, F = rng.normal(size=len(rows)), 20 * rng.normal(size=len(rows))
        v = inverse @ rate
        accelerated = J @ acceleration(robot, q, v, J.T @ F)
        accelerated += twin.jacobian_rate(q, v)[rows] @ v
        left = terms.inertia @ accelerated + terms.coriolis(rate) @ rate + terms.gravity
        np.testing.assert_allclose(left, F, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", ["ur5e", "planar2", "palletizer.urdf"])
def test_the_rate_of_inertia_less_twice_the_coriolis_matrix_is_skew(load: Load, name: str) -> None:
    """Property 4.2, where every joint motion is one of the tool: by central differences."""
    robot, q = load(name), np.array(ARMS[name])
    assert robot.n == len(robot.axes)
    rate = np.random.default_rng(1).normal(size=robot.n)
    terms = operational_terms(robot.twin(), robot.axes, q)
    rows = [axis.row for axis in robot.axes]
    v, h = np.linalg.solve(robot.twin().jacobian(q)[rows], rate), 1e-5
    before, after = (
        operational_terms(robot.twin(), robot.axes, q + sign * h * v).inertia for sign in (-1, 1)
    )
    skew = (after - before) / (2 * h) - 2 * terms.coriolis(rate)
    scale = np.abs(terms.coriolis(rate)).max()
    assert scale > 0
    np.testing.assert_allclose(skew + skew.T, 0, atol=1e-6 * scale)


def test_two_links_in_closed_form(load: Load) -> None:
    """H_x = J^-T H J^-1 of planar2, with J of its two links by hand."""
    robot, q = load("planar2"), np.array([0.4, 1.1])
    terms = operational_terms(robot.twin(), robot.axes, q)
    elbow = np.linalg.norm(robot.twin().tip(np.array([0.0, np.pi])).translation)
    reach = np.linalg.norm(robot.twin().tip(np.zeros(2)).translation)
    first, second = (reach + elbow) / 2, (reach - elbow) / 2
    s, c = np.sin([0.4, 1.5]), np.cos([0.4, 1.5])
    links = sorted([first, second], reverse=True)
    candidates = []
    for a, b in (links, links[::-1]):
        J = np.array([[-a * s[0] - b * s[1], -b * s[1]], [a * c[0] + b * c[1], b * c[1]]])
        inverse = np.linalg.inv(J)
        candidates.append(inverse.T @ robot.twin().inertia(q) @ inverse)
    assert any(np.allclose(terms.inertia, each, rtol=1e-9) for each in candidates)
    least, largest = terms.masses()
    np.testing.assert_allclose([least, largest], np.linalg.eigvalsh(terms.inertia))
    assert terms.masses(angular=True) == (0.0, 0.0)


@pytest.mark.parametrize("name", ["ur5e", "panda", "planar2"])
def test_the_coriolis_bound_holds_and_is_not_loose(load: Load, name: str) -> None:
    robot = load(name)
    terms = operational_terms(robot.twin(), robot.axes, np.array(ARMS[name]))
    rows = [i for i, axis in enumerate(robot.axes) if not axis.is_rotation]
    rng, found = np.random.default_rng(2), []
    for _ in range(2000):
        rate = np.zeros(len(robot.axes))
        rate[rows] = rng.normal(size=len(rows))
        rate /= np.linalg.norm(rate)
        found.append(np.linalg.norm(terms.coriolis(rate)[np.ix_(rows, rows)], 2))
    assert max(found) <= terms.coriolis_bound() * (1 + 1e-9)
    assert terms.coriolis_bound() <= np.sqrt(3) * max(found) * 1.01


def test_gravity_is_the_weight_that_the_arm_carries(load: Load) -> None:
    """Of planar arms in a horizontal plane none; the force that balances g by J^T elsewhere."""
    flat = load("planar2")
    level = operational_terms(flat.twin(), flat.axes, np.array(ARMS["planar2"]))
    np.testing.assert_allclose(level.gravity, 0, atol=1e-12)
    robot, q = load("ur5e"), np.array(ARMS["ur5e"])
    terms = operational_terms(robot.twin(), robot.axes, q)
    J = robot.twin().jacobian(q)
    np.testing.assert_allclose(J.T @ terms.gravity, robot.twin().gravity(q), atol=1e-9)
    assert np.abs(pin.computeGeneralizedGravity(robot.pin, robot.pin.createData(), q)).max() > 1


def test_a_singular_pose_has_no_operational_space(load: Load) -> None:
    robot = load("planar2")
    with pytest.raises(SingularPoseError):
        operational_terms(robot.twin(), robot.axes, np.array([0.4, 0.0]))
