"""Equations of the world: forces along unit gradients, of the declared stiffness."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from plants import Pushed
from taskspec.program.world.equations import equation_models
from taskspec.program.world.stiffness import equation_compliance

SLOPE = "rail: {{equation: '{scale} * (z - 400 mm + x - 500 mm) {relation} 0', {more}}}"


def slope(relation: str = "=", scale: str = "1", more: str = "stiffness: 20 kN/m") -> str:
    return SLOPE.format(relation=relation, scale=scale, more=more)


@pytest.mark.parametrize("scale", ["1", "250"])
def test_a_push_deforms_by_force_over_stiffness_whatever_the_scale(scale):
    pushed = Pushed(slope(scale=scale), damping=30)
    n = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    pushed.push(-30 * n, 4.0, spring=200.0)
    force = pushed.plant.views.equations[0]
    distance = n @ (pushed.tip - [0.5, 0.0, 0.4])
    assert force < -10
    # The slowest joint against its spring decays with 30/200 s: what moves yet is 1e-6 of it.
    assert force / distance == pytest.approx(20e3, rel=1e-5)
    # By the environment, at the tip, with no moment about it: it balances the joints.
    np.testing.assert_allclose(pushed.plant.arm.wrench, [*(-force * n), 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(pushed.unbalanced(), 0.0, atol=1e-3)


@pytest.mark.parametrize(("relation", "holds"), [("<=", 1), (">=", -1)])
def test_one_sided_equations_only_push(relation, holds):
    n = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    held, left = Pushed(slope(relation), damping=30), Pushed(slope(relation))
    held.push(holds * 30 * n, 1.0, spring=200.0)
    left.push(-holds * 30 * n, 0.2)
    assert holds * held.plant.views.equations[0] > 10.0
    assert left.plant.views.equations[0] == 0.0
    assert -holds * n @ (left.tip - [0.5, 0.0, 0.4]) > 0.01


def test_an_equation_on_joints_acts_on_them_alone():
    world = "tie: {equation: 'q1 - 2*q2 = OFFSET', stiffness: 2 kN*m/rad}"
    q = Pushed("").start
    pushed = Pushed(world.replace("OFFSET", f"{float(q[0] - 2 * q[1])!r} rad"), damping=30)
    n = np.zeros(7)
    n[:2] = np.array([1.0, -2.0]) / np.sqrt(5)
    for _ in range(3000):
        pushed.plant.step(10.0 * n)
    assert pushed.plant.views.equations[0] == pytest.approx(10.0, rel=1e-4)
    assert n @ (pushed.plant.arm.q - q) == pytest.approx(10.0 / 2e3, rel=1e-4)
    np.testing.assert_array_equal(pushed.plant.arm.wrench, 0.0)


def test_equations_take_no_power_but_what_moves():
    """A frictionless constraint that stands still: kinetic energy changes by the joints' work."""
    pushed = Pushed(slope(more="stiffness: rigid, damping: 0 N*s/m"))
    pushed.push(np.array([5.0, 10.0, -5.0]), 0.05)
    plant, n = pushed.plant, np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
    before = plant.arm.kinetic_energy()
    pushed.push(0.0, 0.1)
    spring = 0.5 * plant.views.equations[0] ** 2 / stiffness(pushed)
    # Semi-implicit Euler keeps energy to first order in the step.
    assert plant.arm.kinetic_energy() + spring == pytest.approx(before, rel=5e-3)
    assert abs(n @ (pushed.tip - [0.5, 0.0, 0.4])) < 1e-4


def stiffness(pushed: Pushed) -> float:
    model = equation_models(pushed.task)["rail"]
    declared = pushed.task.equations["rail"]
    return equation_compliance(model, pushed.robot, pushed.start, declared, 1e-3).stiffness


def test_rigid_is_half_a_radian_in_a_step():
    pushed = Pushed(slope(more="stiffness: rigid"))
    J = pushed.jacobian()
    n = np.array([1.0, 0.0, 1.0, 0.0, 0.0, 0.0]) / np.sqrt(2)
    H = np.triu(pin.crba(pushed.robot.pin, pushed.robot.pin.createData(), pushed.start))
    H += np.triu(H, 1).T
    mass = 1.0 / (n @ J @ np.linalg.solve(H, J.T) @ n)
    assert stiffness(pushed) == pytest.approx(mass * (0.5 / 1e-3) ** 2, rel=1e-9)


def test_an_equation_that_moves_carries_the_tip_along():
    """Rheonomic: the tip follows a rising plane z = 400 mm + 20 mm/s * clock."""
    pushed = Pushed(
        "lift: {equation: 'z = 400 mm + 20 mm/s * clock', stiffness: 50 kN/m}", damping=5
    )
    pushed.push(0.0, 1.0)
    clock = pushed.data.time - 1e-3
    # The force that moves the damped joints deforms it.
    lag = pushed.plant.views.equations[0] / 50e3
    assert pushed.tip[2] - (0.4 + 0.02 * clock) == pytest.approx(lag, abs=2e-5)


def test_a_mixed_equation_pushes_along_the_place_and_turns_by_its_lever():
    """rz + 5 rad/m z = 0: a force along z with 200 mm times it about z."""
    jig = (
        "frame: mount, equation: 'rz + 5 rad/m * z = 0 rad', stiffness: 20 kN/m, damping: 60 N*s/m"
    )
    nothing = "stiffness: [0, 0, 0, 0, 0, 0], damping: [1 N*s/m, 0, 0, 0, 0, 0]"
    mount = f"mount: {{bushing: tool, xyz: [500 mm, 0, 400 mm], {nothing}}}"
    pushed = Pushed(f"{mount}, rail: {{{jig}}}", damping=30)
    pushed.push(np.array([0.0, 0.0, -20.0]), 4.0, spring=200.0)
    force = pushed.plant.views.equations[0]
    R = pushed.plant.arm.tip_rotation.reshape(3, 3).copy()
    F = np.diag([1.0, -1.0, -1.0])
    turn, place = pin.log3(F.T @ R), F.T @ (pushed.tip - [0.5, 0.0, 0.4])
    assert force > 5
    assert force / ((turn[2] + 5 * place[2]) / 5) == pytest.approx(20e3, rel=1e-3)
    # The gradient of rz along turns is the last row of the inverse left Jacobian.
    half = np.linalg.norm(turn) / 2
    factor = (1 - half / np.tan(half)) / (4 * half**2) if half else 1 / 12
    W = pin.skew(turn)
    gradient = (np.eye(3) - W / 2 + factor * W @ W)[2]
    wrench = [*(F @ [0, 0, -force]), *(F @ gradient * -force / 5)]
    np.testing.assert_allclose(pushed.plant.arm.wrench, wrench, atol=2e-3)
    np.testing.assert_allclose(pushed.unbalanced(), 0.0, atol=1e-2)


def test_an_angle_between_axes_turns_about_both():
    lean = "lean: {equation: 'angle(tool.z, world.x) = 80 deg', stiffness: 500 N*m/rad}"
    pushed = Pushed(lean, damping=30)
    pushed.push(0.0, 4.0, spring=200.0)
    torque, axis = (
        pushed.plant.views.equations[0],
        pushed.plant.arm.tip_rotation.reshape(3, 3)[:, 2],
    )
    about = np.cross([1.0, 0, 0], axis)
    about /= np.linalg.norm(about)
    assert abs(torque) > 1
    assert torque / (np.arccos(axis[0]) - np.deg2rad(80)) == pytest.approx(500, rel=1e-3)
    np.testing.assert_allclose(pushed.plant.arm.wrench, [0, 0, 0, *(-torque * about)], atol=1e-3)
