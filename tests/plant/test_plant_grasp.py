"""The grasp: a spring and damper of the declared size, and what goes through it."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from plants import Pushed
from taskspec.program.world.stiffness import GRIP

CRANK = (
    "crank: {mechanism: hinge, xyz: [500 mm, 0, 400 mm], handle: [120 mm, 0, 0], "
    "inertia: 0.02 kg*m^2, %s}"
)
BLOCK = (
    "block: {shape: box, xyz: [500 mm, 0, 375 mm], size: [60 mm, 40 mm, 50 mm], free: true, "
    "mass: 1.5 kg}"
)
DRAWER = (
    "drawer: {mechanism: slide, xyz: [620 mm, 0, 400 mm], rpy: [0, 90 deg, 0], mass: 3 kg, "
    "damping: 20 N*s/m}"
)
SCREW = (
    "screw: {mechanism: screw, xyz: [500 mm, 0, 400 mm], handle: [120 mm, 0, 0], "
    "pitch: 20 mm/turn, inertia: 0.02 kg*m^2, mass: 0.5 kg, damping: 0.05 N*m*s/rad}"
)
AT_HANDLE = "[620 mm, 0, 400 mm]"


def crank(more: str = "knob: free", damping: float = 0.0) -> Pushed:
    return Pushed(CRANK % more, "grasp: crank.handle", start=AT_HANDLE, damping=damping)


def block(damping: float = 0.0) -> Pushed:
    return Pushed(BLOCK, "grasp: block", damping=damping)


def held_body(pushed: Pushed) -> int:
    site = pushed.model.site(pushed.plant.scene.arm.element("grip/held")).id
    return int(pushed.model.site_bodyid[site])


def relative(pushed: Pushed) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(6,) pose, velocity and acceleration of the tip against what it holds, world axes."""
    m, d = pushed.model, pushed.data
    arm = pushed.plant.scene.arm
    sites = [m.site(arm.element(f"grip/{name}")).id for name in ("tip", "held")]
    bodies = [pushed.body, held_body(pushed)]
    turned = [d.site_xmat[s].reshape(3, 3) for s in sites]
    pose = np.concatenate(
        [d.site_xpos[sites[0]] - d.site_xpos[sites[1]], pin.log3(turned[0] @ turned[1].T)]
    )
    rates = []
    for rate in (d.qvel, d.qacc):
        twists = []
        for site, body in zip(sites, bodies, strict=True):
            J = np.zeros((6, m.nv))
            mujoco.mj_jac(m, d, J[:3], J[3:], d.site_xpos[site], body)
            twists.append(J @ rate)
        rates.append(twists[0] - twists[1])
    return pose, rates[0], rates[1]


@pytest.mark.parametrize("make", [crank, block, lambda: crank("knob: fixed")])
def test_the_coupling_has_the_declared_stiffness_and_damping(make):
    """From states off its rest: f = -(k r + b r' + b T r''), its virtual mass b T included."""
    k = np.repeat([GRIP.stiffness, GRIP.angular_stiffness], 3)
    b = np.repeat([GRIP.damping, GRIP.angular_damping], 3)
    rng = np.random.default_rng(0)
    pushed = make()
    plant, data = pushed.plant, pushed.data
    for _ in range(20):
        data.qpos[:7] = pushed.start + 3e-4 * rng.normal(size=7)
        data.qvel[:] = 1e-2 * rng.normal(size=pushed.model.nv)
        mujoco.mj_forward(pushed.model, data)
        plant.arm.read_forces()
        pose, rate, acceleration = relative(pushed)
        expected = -(k * pose + b * rate + b * 1e-3 * acceleration)
        # Angles of 1e-3 make sin(angle/2) and its axes differ from the rotation vector by 1e-3;
        # J' q' of the acceleration is left out: 0.3 kg * (0.03 rad/s)^2 * 1 m.
        np.testing.assert_allclose(plant.arm.wrench[:3], expected[:3], rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(plant.arm.wrench[3:], expected[3:], rtol=5e-3, atol=2e-3)


def test_a_held_weight_is_felt_as_it_is():
    pushed = block(damping=60.0)
    pushed.push(0.0, 4.0, spring=2000.0)
    weight = np.array([0.0, 0.0, -1.5 * 9.81])
    lever = pushed.data.xipos[held_body(pushed)] - pushed.tip
    np.testing.assert_allclose(pushed.plant.arm.wrench[:3], weight, rtol=1e-4, atol=1e-3)
    np.testing.assert_allclose(pushed.plant.arm.wrench[3:], np.cross(lever, weight), atol=1e-4)
    np.testing.assert_allclose(pushed.unbalanced(), 0.0, atol=1e-3)
    assert pushed.plant.arm.object_forces[0] == pytest.approx(1.5 * 9.81, rel=1e-4)
    # The tip is above what hangs on it.
    sag = relative(pushed)[0]
    assert sag[2] == pytest.approx(-weight[2] / GRIP.stiffness, rel=1e-2)


def test_a_moment_on_a_fixed_knob_turns_and_one_on_a_free_knob_does_not():
    for knob, turns in (("fixed", True), ("free", False)):
        pushed = crank(f"knob: {knob}, stop: 0 .. 60 deg", damping=10.0)
        pushed.push([0, 0, 0, 0, 0, -3.0], 2.0, spring=500.0)
        effort = pushed.plant.views.mechanism_efforts[0]
        force, moment = pushed.plant.arm.wrench[:3], pushed.plant.arm.wrench[3:]
        lever = pushed.tip - [0.5, 0, 0.4]
        expected = -(np.cross(lever, force)[2] + (moment[2] if turns else 0.0))
        # The force acts at the handle, which is |force|/k away from the tip.
        assert effort == pytest.approx(expected, abs=1e-3)
        assert abs(moment[2]) > 0.5 if turns else abs(moment[2]) < 1e-6


@pytest.mark.parametrize(
    ("world", "inertia", "damping"),
    [
        (CRANK % "knob: free, damping: 0.05 N*m*s/rad", 0.02, 0.05),
        (CRANK % "knob: fixed, damping: 0.05 N*m*s/rad", 0.02, 0.05),
        (DRAWER, 3.0, 20.0),
        (SCREW, 0.02 + 0.5 * (0.02 / (2 * np.pi)) ** 2, 0.05),
    ],
)
def test_power_from_the_robot_is_energy_and_losses(world, inertia, damping):
    name = world.partition(":")[0]
    pushed = Pushed(world, f"grasp: {name}.handle", start=AT_HANDLE, damping=0.2)
    b = np.repeat([GRIP.damping, GRIP.angular_damping], 3)
    way = []
    for k in range(600):
        J, before = pushed.jacobian(), pushed.plant.arm.v.copy()
        pushed.push([-30.0, 20.0 * np.cos(k / 50), 5.0], 1e-3)
        views, slip = pushed.plant.views, relative(pushed)[1]
        tip = J @ (before + pushed.plant.arm.v) / 2
        power, loss = -pushed.plant.arm.wrench @ tip, slip @ (b * slip)
        way.append((views.mechanism_rates[0], views.mechanism_efforts[0], power, loss))
    rate, effort, power, loss = np.array(way).T
    # In step k the effort acts between the rates k and k + 1: a semi-implicit step's own balance.
    middle = (rate[1:] + rate[:-1]) / 2
    into = np.sum(effort[:-1] * middle) * 1e-3
    lost = np.sum(damping * rate[1:] * middle) * 1e-3
    energy = 0.5 * inertia * (rate[-1] ** 2 - rate[0] ** 2)
    assert into > 0.1
    assert into == pytest.approx(energy + lost, rel=2e-3)
    # What leaves the robot at the tip goes there, or into the grip's own spring and damper.
    k = np.repeat([GRIP.stiffness, GRIP.angular_stiffness], 3)
    pose = relative(pushed)[0]
    grip = np.sum(loss) * 1e-3 + 0.5 * pose @ (k * pose)
    assert np.sum(power) * 1e-3 == pytest.approx(into + grip, rel=0.01)


def test_the_lightest_knob_does_not_ring():
    pushed = crank(damping=1.0)
    pushed.push([0.0, 15.0, 0.0], 0.3)
    forces = []
    for _ in range(200):
        pushed.push([0.0, 15.0, 0.0], 1e-3)
        forces.append(pushed.plant.arm.wrench.copy())
    # A ringing grip would alternate from step to step.
    assert np.max(np.abs(np.diff(forces, 2, axis=0))) < 0.05


def test_a_grasp_is_at_rest_before_the_run():
    for pushed in (crank(), crank("knob: fixed")):
        np.testing.assert_allclose(pushed.plant.arm.wrench, 0.0, atol=1e-6)


@pytest.mark.parametrize("knob", ["free", "fixed"])
def test_a_stop_holds_the_whole_arm(knob):
    """An arm that swings a crank into its stop at some rad/s: within 1 % of the range beyond it."""
    pushed = crank(f"knob: {knob}, stop: -30 deg .. 60 deg", damping=1.0)
    way, rates = [], []
    for _ in range(1500):
        pushed.push([0.0, 25.0, 0.0], 1e-3)
        way.append(pushed.plant.views.mechanism_positions[0])
        rates.append(pushed.plant.views.mechanism_rates[0])
    assert np.max(rates) > 3.0
    assert 0.0 < np.max(way) - np.pi / 3 < 0.01 * np.pi / 2
    assert abs(way[-1] - np.pi / 3) < 1e-3
