"""Bushings: wrenches of a potential in six dimensions, whatever the stiffness couples."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import pose_spring
from plants import Pushed
from taskspec.program.world import tip_pose
from taskspec.program.world.bushings import bushing_models, wrench_on_tip
from taskspec.spec import load_text

ROWS = """[
  [3 kN/m, 200 N/m, 0, 0, 100 N/rad, 5 N],
  [200 N/m, 2 kN/m, 0, -80 N, 0, 0],
  [0, 0, 8 kN/m, 0, 0, 20 N],
  [0, -80 N/rad, 0, 30 N*m/rad, 4 N*m/rad, 0],
  [100 N, 0, 0, 4 N*m/rad, 25 N*m/rad, 0],
  [5 N, 0, 20 N, 0, 0, 15 N*m/rad]]"""
K = np.array(
    [
        [3000, 200, 0, 0, 100, 5],
        [200, 2000, 0, -80, 0, 0],
        [0, 0, 8000, 0, 0, 20],
        [0, -80, 0, 30, 4, 0],
        [100, 0, 0, 4, 25, 0],
        [5, 0, 20, 0, 0, 15],
    ],
    dtype=float,
)
STILL = np.zeros(6)
P_B = np.array([0.505, 0.003, 0.395])
REST = "xyz: [505 mm, 3 mm, 395 mm], rpy: [178 deg, 4 deg, 5 deg]"
DAMPED = "damping: [30 N*s/m, 20 N*s/m, 10 N*s/m, 1 N*m*s/rad, 2 N*m*s/rad, 3 N*m*s/rad]"
D = np.diag([30.0, 20.0, 10.0, 1.0, 2.0, 3.0])


def mount(more: str = DAMPED) -> str:
    return f"mount: {{bushing: tool, {REST}, stiffness: {ROWS}, {more}}}"


def rest_axes() -> np.ndarray:
    """R of roll, pitch, yaw about fixed axes."""
    return np.linalg.multi_dot(
        [
            pose_spring.turned(np.deg2rad(angle) * np.eye(3)[i])
            for i, angle in ((2, 5.0), (1, 4.0), (0, 178.0))
        ]
    )


def model(more: str = DAMPED):
    text = f"taskspec: 1\nrobot: {{model: panda}}\nworld: {{{mount(more)}}}\n"
    task = load_text(text + "stages: {wait: {time: 1 s}}\n", "t.yaml").task
    return bushing_models(task)["mount"]


def on_tip(of):
    """The wrench of the plant's function, by pose and twist."""
    x, twist = ca.SX.sym("x", 12), ca.SX.sym("twist", 6)
    wrench, local = wrench_on_tip(x, twist, ca.SX(of.numbers))
    function = ca.Function("wrench", [x, twist], [wrench, local])

    def at(p, R, rate=STILL):
        found = function(tip_pose.pose(ca.DM(p), ca.DM(R)), rate)
        return tuple(np.array(part).ravel() for part in found)

    return at


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.02, 1.0, 3.0])
def test_the_wrench_is_that_of_matrices_alone(angle):
    rng, R_b, at = np.random.default_rng(7), rest_axes(), on_tip(model())
    for _ in range(5):
        axis = rng.standard_normal(3)
        R = R_b @ pose_spring.turned(angle * axis / np.linalg.norm(axis))
        p, twist = P_B + 0.05 * rng.standard_normal(3), rng.standard_normal(6)
        expected = pose_spring.wrench(p, R, P_B, R_b, K, D, twist)
        wrench, local = at(p, R, twist)
        np.testing.assert_allclose(wrench, expected, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(local, np.kron(np.eye(2), R_b.T) @ -expected, atol=1e-9)


def way(count: int):
    """A closed way in the space of poses with large turns, and its twists per step."""
    R_b = rest_axes()
    s = 2 * np.pi * np.arange(count + 1) / count
    places = P_B + 0.05 * np.column_stack([np.sin(s), np.cos(2 * s), np.sin(3 * s)])
    turns = 1.2 * np.column_stack([np.cos(s), np.sin(s), np.sin(2 * s)])
    axes = [R_b @ pose_spring.turned(w) for w in turns]
    return places, axes


def work(wrench, count: int = 2000) -> float:
    """What a wrench does along the closed way, by the rule of midpoints [J]."""
    places, axes = way(count)
    total = 0.0
    for p, q, R, S in zip(places, places[1:], axes, axes[1:], strict=False):
        turn = pose_spring.vector(S @ R.T)
        middle = wrench((p + q) / 2, pose_spring.turned(turn / 2) @ R)
        total += middle @ np.concatenate([q - p, turn])
    return float(total)


def test_a_closed_way_takes_no_work_out_of_the_spring():
    """And the spring that leaves the Jacobian of the rotation vector out gives some away."""
    R_b, at = rest_axes(), on_tip(model())

    def naive(p, R):
        return -np.kron(np.eye(2), R_b) @ K @ pose_spring.coordinates(p, R, P_B, R_b)

    coarse = abs(work(lambda p, R: at(p, R)[0], 500))
    exact, given = work(lambda p, R: at(p, R)[0]), work(naive)
    # The rule of midpoints is of second order: four times the steps, a sixteenth of the rest.
    assert abs(exact) < 1e-4
    assert abs(exact) < 0.1 * coarse
    assert abs(given) > 1.0


def test_the_damper_only_takes():
    rng, R_b = np.random.default_rng(3), rest_axes()
    at, taken = on_tip(model()), []
    for _ in range(20):
        R, p = R_b @ pose_spring.turned(rng.standard_normal(3)), P_B + rng.standard_normal(3)
        twist = rng.standard_normal(6)
        taken.append((at(p, R, twist)[0] - at(p, R)[0]) @ twist)
    assert len(taken) == 20
    assert max(taken) < 0


def test_a_damping_left_out_is_a_tenth_of_critical_mode_by_mode():
    of = model("")
    unit = np.diag([1.0] * 3 + [0.05] * 3)
    values, modes = np.linalg.eig(np.linalg.solve(unit, K))
    for value, mode in zip(values, modes.T, strict=True):
        np.testing.assert_allclose(of.damping @ mode, 0.2 * np.sqrt(value) * unit @ mode, atol=1e-9)


def test_the_plant_exerts_it_and_the_sensor_measures_it():
    pushed = Pushed(mount(), damping=30)
    pushed.push(np.array([10.0, 5.0, -20.0]), 4.0, spring=50.0)
    arm = pushed.plant.arm
    R = arm.tip_rotation.reshape(3, 3).copy()
    expected = pose_spring.wrench(pushed.tip, R, P_B, rest_axes(), K, D, np.zeros(6))
    assert np.linalg.norm(expected[:3]) > 5.0
    # What still creeps at the end of the push is below this [N, N m].
    np.testing.assert_allclose(arm.wrench, expected, atol=2e-3)
    local = np.kron(np.eye(2), rest_axes().T) @ -arm.wrench
    np.testing.assert_allclose(pushed.plant.views.bushings, local, atol=1e-12)
    np.testing.assert_allclose(pushed.unbalanced(), 0.0, atol=1e-2)


def test_an_undamped_arm_on_it_keeps_its_energy():
    pushed = Pushed(mount("damping: [0, 0, 0, 0, 0, 0]"))
    plant, R_b, energies = pushed.plant, rest_axes(), []
    for _ in range(400):
        plant.step(np.zeros(7))
        R = plant.arm.tip_rotation.reshape(3, 3)
        xi = pose_spring.coordinates(pushed.tip, R, P_B, R_b)
        energies.append((plant.arm.kinetic_energy(), 0.5 * xi @ K @ xi))
    kinetic, spring = np.array(energies).T
    total = kinetic + spring
    # Semi-implicit Euler keeps energy to first order in the step; it goes over and back meanwhile.
    assert kinetic.max() > 0.5 * total.max()
    np.testing.assert_allclose(total, total.mean(), rtol=0.1)
    assert abs(total[-100:].mean() / total[:100].mean() - 1) < 0.02


def test_the_true_spring_may_be_another(simulate):
    """2 kN/m of the law against 2 kN/m in truth, 6 mm apart: 6 N, where the file has 9.6 N."""
    softer = "[3 kN/m, 3 kN/m, 2 kN/m, 30 N*m/rad, 30 N*m/rad, 15 N*m/rad]"
    run = simulate(
        f"""
taskspec: 1
name: softer
robot: {{model: panda, start: {{xyz: [500 mm, 0, 350 mm]}}}}
world:
  mount: {{bushing: tool, xyz: [500 mm, 0, 344 mm],
          stiffness: [3 kN/m, 3 kN/m, 8 kN/m, 30 N*m/rad, 30 N*m/rad, 15 N*m/rad]}}
law: {{kind: pd, stiffness: {{linear: 2 kN/m, angular: 40 N*m/rad}}}}
stages: {{hold: {{time: 4 s}}}}
truth: {{world.mount.stiffness: {softer}}}
"""
    )
    assert run["force.z"][-1] == pytest.approx(6.0, abs=1e-4)
    # In the axes of the rest pose, whose z is down; its place is where the tip truly is.
    assert run["mount.force.z"][-1] == pytest.approx(-6.0, abs=1e-4)
    assert run["mount.position.z"][-1] == pytest.approx(-3e-3, abs=1e-7)
