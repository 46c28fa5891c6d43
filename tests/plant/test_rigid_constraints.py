"""Equations that hold exactly: the plant's step is (4.78), with lambda by (4.77)."""

from __future__ import annotations

import shutil
from pathlib import Path

import casadi as ca
import mujoco
import numpy as np
import pinocchio as pin
import pytest

import constrained_forms
from plants import Pushed
from taskspec import load
from taskspec.control import linear
from taskspec.program.world.equations import equation_models
from taskspec_runner import run
from taskspec_runner.plant import rigid_constraints
from taskspec_runner.plant.plant import Plant

DATA = Path(__file__).parents[1] / "robot" / "data"
TASKS = Path(__file__).parents[2] / "tasks"
SLOPE = "rail: {{equation: '{scale} * (z - 400 mm + x - 500 mm) = 0', stiffness: exact}}"
NORMAL = np.array([1.0, 0.0, 1.0]) / np.sqrt(2)
#: A ball about (0, 0, 200 mm) through the start.
BALL = "rail: {{equation: 'x^2 + y^2 + (z - 200 mm)^2 = (0.5 m)^2 + (0.2 m)^2', stiffness: {k}}}"
RADIUS = np.hypot(0.5, 0.2)


def off_the_ball(pushed: Pushed) -> float:
    return float(np.linalg.norm(pushed.tip - [0, 0, 0.2]) - RADIUS)


def watched(pushed: Pushed, force: object, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The multiplier and the tip (3,) of every step under a force at the tip."""
    forces, tips = [], []
    for _ in range(steps):
        pushed.push(force, 1e-3)
        forces.append(pushed.plant.views.equations[0])
        tips.append(pushed.tip.copy())
    return np.array(forces), np.array(tips)


@pytest.mark.parametrize("scale", ["1", "250"])
def test_at_rest_it_bears_the_force_that_presses_whatever_the_scale(scale):
    pushed = Pushed(SLOPE.format(scale=scale), damping=30)
    pushed.push(-30 * NORMAL, 4.0, spring=200.0)
    assert pushed.plant.views.equations[0] == pytest.approx(-30.0, abs=1e-6)
    assert abs(NORMAL @ (pushed.tip - [0.5, 0.0, 0.4])) < 1e-12
    # By the environment, at the tip, with no moment about it: it balances the joints.
    np.testing.assert_allclose(pushed.plant.arm.wrench, [*(30 * NORMAL), 0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(pushed.unbalanced(), 0.0, atol=1e-6)


def test_drift_is_of_third_order_in_the_step():
    """At up to 1.8 m/s on a ball of 0.54 m: 0.23 um, an eighth of it in half the step."""
    most = []
    for rate in (1, 2, 4):
        pushed = Pushed(BALL.format(k="exact"), rate=rate)
        drift = []
        for _ in range(200):
            pushed.push([5.0, 20.0, -5.0], 1e-3)
            drift.append(abs(off_the_ball(pushed)))
        most.append(max(drift))
        speed = float(np.linalg.norm(pushed.jacobian()[:3] @ pushed.plant.arm.v))
        assert 0.5 < speed < 2.0
    assert 1e-8 < most[0] < 3e-7
    assert most[0] / most[1] == pytest.approx(8.0, rel=0.2)
    assert most[1] / most[2] == pytest.approx(8.0, rel=0.2)


def test_drift_does_not_grow():
    """What a step leaves is taken back by the next one: 3 s are no worse than the first half."""
    pushed = Pushed(BALL.format(k="exact"))
    pushed.push([0.0, 20.0, 0.0], 0.2)
    drift = []
    for _ in range(3000):
        pushed.plant.step(np.zeros(7))
        drift.append(abs(off_the_ball(pushed)))
    assert pushed.plant.arm.kinetic_energy() > 0.5
    assert 1e-10 < max(drift[1500:]) < 1.5 * max(drift[:1500])


class Reduced:
    """The arm on its equations by the reduced form (4.93), integrated by Runge-Kutta.

    Pinocchio's algorithms give the arm's terms. The order of the coordinates is chosen once: q_1
    is the joint along which the equation changes most.
    """

    def __init__(self, pushed: Pushed) -> None:
        robot = pushed.robot
        self._model, self._data = robot.pin, robot.pin.createData()
        self._tip, n = robot.pin.getFrameId("tip"), robot.n
        (self._equation,) = equation_models(pushed.task).values()
        H, bias, J = ca.SX.sym("H", n, n), ca.SX.sym("bias", n), ca.SX.sym("J", 3, n)
        p, drift, t = ca.SX.sym("p", 3), ca.SX.sym("drift", 3), ca.SX.sym("t")
        v, u = ca.SX.sym("v", n), ca.SX.sym("u", n)
        terms = self._equation.terms(p, t, J @ v)
        J_phi, gamma = terms.normal @ J, terms.drift + terms.normal @ drift
        inputs = [H, bias, J, p, drift, v, u, t]
        still = self._terms(pushed.start, np.zeros(n))
        at_start = ca.Function("row", inputs, [J_phi])(*still, np.zeros(n), 0)
        first = int(np.argmax(np.abs(np.array(at_start))))
        reduced = constrained_forms.reduction(J_phi, gamma, [first])
        dynamics = constrained_forms.reduced_dynamics(reduced, H, bias)
        force = dynamics.n - reduced.T.T @ u
        free = -linear.solve(linear.cholesky(dynamics.H[1:, 1:]), force[1:])
        acceleration = reduced.T @ ca.vertcat(0, free) + reduced.Gamma
        multiplier = constrained_forms.reduced_multipliers(reduced, dynamics, u, J_phi)
        self._function = ca.Function("reduced", inputs, [acceleration, multiplier])

    def _terms(self, q, v):
        model, data = self._model, self._data
        H = np.triu(pin.crba(model, data, q))
        H += np.triu(H, 1).T
        bias = pin.nonLinearEffects(model, data, q, v) - pin.computeGeneralizedGravity(
            model, data, q
        )
        pin.forwardKinematics(model, data, q, v, 0 * v)
        world = pin.LOCAL_WORLD_ALIGNED
        J = pin.computeFrameJacobian(model, data, q, self._tip, world)[:3]
        pin.updateFramePlacement(model, data, self._tip)
        drift = pin.getFrameClassicalAcceleration(model, data, self._tip, world).linear
        return H, bias, J, data.oMf[self._tip].translation, drift, v

    def at(self, q, v, u, t):
        """q'' (n,) and the multiplier, by the environment along the unit gradient."""
        acceleration, multiplier = self._function(*self._terms(q, v), u, t)
        return np.array(acceleration).ravel(), float(multiplier)

    def course(self, q, u, seconds, h=5e-4):
        """q, v (n,) and the multiplier after some time from rest, under a constant torque."""
        v = np.zeros(len(q))
        for k in range(round(seconds / h)):
            t = k * h
            a1, _ = self.at(q, v, u, t)
            v2 = v + h / 2 * a1
            a2, _ = self.at(q + h / 2 * v, v2, u, t + h / 2)
            v3 = v + h / 2 * a2
            a3, _ = self.at(q + h / 2 * v2, v3, u, t + h / 2)
            v4 = v + h * a3
            a4, _ = self.at(q + h * v3, v4, u, t + h)
            q = q + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        return q, v, self.at(q, v, u, seconds)[1]


MOVING = (
    "rail: {equation: 'z = 400 mm + 30 mm * (1 - cos(2*pi*clock*2 Hz)) + 0.3 * (x - 500 mm)"
    " + 2 /m * y^2', stiffness: exact}"
)


@pytest.mark.parametrize("world", [BALL.format(k="exact"), MOVING], ids=["ball", "moving"])
def test_its_course_tends_to_that_of_the_reduced_form(world):
    """(4.93) and (4.96), integrated by themselves: the plant differs by the order of its step."""
    torque = np.array([2.0, -3.0, 1.0, -2.0, 0.5, 0.4, 0.1])
    away = []
    for rate in (1, 2, 4, 8):
        pushed = Pushed(world, rate=rate)
        for _ in range(300):
            pushed.plant.step(torque)
        if rate == 1:
            q, v, multiplier = Reduced(pushed).course(pushed.start, torque, 0.3)
            assert np.abs(q - pushed.start).max() > 0.1
            assert abs(multiplier) > 1.0
        away.append(
            (
                np.abs(pushed.plant.arm.q - q).max(),
                np.abs(pushed.plant.arm.v - v).max(),
                abs(-pushed.plant.views.equations[0] - multiplier),
            )
        )
    errors = np.array(away)
    assert (errors[0] < [0.01, 0.1, 0.02 * abs(multiplier)]).all()
    np.testing.assert_allclose(errors[:-1, :2] / errors[1:, :2], 2.0, rtol=0.1)
    # What is logged is of the last step, which begins one of them before the end.
    assert errors[-1, 2] < 0.25 * errors[0, 2]


def test_a_scleronomic_one_takes_no_power():
    """Kinetic energy changes by the work of the joints alone, to second order in the step."""
    left = []
    for rate in (1, 4):
        pushed = Pushed(BALL.format(k="exact"), rate=rate)
        pushed.push([5.0, 30.0, -5.0], 0.05)
        plant = pushed.plant
        before = plant.arm.kinetic_energy()
        for _ in range(200):
            plant.step(np.zeros(7))
        mujoco.mj_forward(plant.model, plant.data)
        left.append(abs(plant.arm.kinetic_energy() / before - 1))
    assert before > 0.5
    assert left[0] < 2e-2
    assert left[1] < 0.3 * left[0]


def test_a_rheonomic_one_gives_the_power_of_what_moves():
    """-lambda^T dr/dt: lifted by 40 mm and stopped, what it gave is what the joints took."""
    lift = "lift: {equation: 'z = 400 mm + 20 mm * (1 - cos(2*pi*clock*1 Hz))', stiffness: exact}"
    pushed = Pushed(lift, rate=4, damping=5)
    work = taken = 0.0
    for k in range(500):
        rate = 0.02 * 2 * np.pi * np.sin(2 * np.pi * (k + 0.5) * 1e-3)
        v = pushed.plant.arm.v.copy()
        pushed.push([0.0, 0.0, -20.0], 1e-3)
        # What the robot applies along +z is against what the plane does; a mean over the tick.
        work += -pushed.plant.views.equations[0] * rate * 1e-3
        mean = (v + pushed.plant.arm.v) / 2
        taken += float((5 * mean - pushed.torque) @ mean) * 1e-3
    mujoco.mj_forward(pushed.model, pushed.data)
    assert work > 0.5
    assert work == pytest.approx(taken + pushed.plant.arm.kinetic_energy(), rel=1e-2)


TABLE = "table: {{shape: plane, xyz: [0, 0, 400 mm], stiffness: {k}, friction: {mu}}}"
BESIDE = {
    "a contact": (TABLE.format(k="20 kN/m", mu=0), ""),
    "friction": (TABLE.format(k="rigid", mu=1), ""),
    "joint friction": ("", "joint_friction: 2 N*m"),
    "a spring": ("wall: {equation: 'x <= 500 mm', stiffness: 50 kN/m}", ""),
    "another": ("other: {equation: 'x - 2*y = 0.5 m', stiffness: exact}", ""),
    "one on joints": ("other: {equation: 'q7 = Q7', stiffness: exact}", ""),
    "a moving table": (
        "table: {shape: plane, xyz: [0, 0, 400 mm], friction: 0.5, motion: {z: 3 mm * "
        "(1 - cos(2*pi*clock*3 Hz))}}",
        "",
    ),
}


@pytest.mark.parametrize("beside", BESIDE)
def test_it_holds_beside_all_else_that_acts(beside, monkeypatch):
    """The step takes contacts, friction and all exact equations together."""
    world, robot = BESIDE[beside]
    q7 = float(Pushed("").start[6])
    world = ", ".join(w for w in (SLOPE.format(scale="1"), world.replace("Q7", f"{q7!r} rad")) if w)
    pushed = Pushed(world, robot, damping=1)
    drift, rounds, pressed = [], [], 0.0
    solve = mujoco.mj_fwdConstraint

    def counted(model, data):
        rounds[-1] += 1
        solve(model, data)

    monkeypatch.setattr(rigid_constraints.mujoco, "mj_fwdConstraint", counted)
    for k in range(300):
        rounds.append(0)
        pushed.push([8 * np.sin(k / 20), 30 * np.cos(k / 30), -20.0], 1e-3)
        mujoco.mj_kinematics(pushed.model, pushed.data)
        place = pushed.data.xpos[pushed.body]
        pressed = max(pressed, abs(pushed.plant.views.equations[0]))
        drift.append(abs(NORMAL @ (place - [0.5, 0.0, 0.4])))
        for name, model in equation_models(pushed.task).items():
            if name == "other" and not model.joints:
                drift.append(abs(np.array([1, -2, 0]) @ (place - [0.5, 0, 0])) / np.sqrt(5))
            if name == "other" and model.joints:
                drift.append(abs(pushed.plant.arm.q[6] - q7))
    assert max(drift) < 3e-7
    assert pressed > 5.0
    assert max(rounds) < rigid_constraints.MOST_ROUNDS
    if "friction" in beside or "contact" in beside:
        assert max(rounds) > 1


def test_without_solving_for_contacts_together_it_would_not(monkeypatch):
    """What contacts exert by the step before is not what they exert under the new multipliers."""
    world = f"{SLOPE.format(scale='1')}, {TABLE.format(k='rigid', mu=1)}"
    drift = {}
    for rounds in (1, rigid_constraints.MOST_ROUNDS):
        monkeypatch.setattr(rigid_constraints, "MOST_ROUNDS", rounds)
        pushed = Pushed(world, damping=1)
        _, tips = watched(pushed, [8.0, 30.0, -20.0], 200)
        drift[rounds] = np.abs((tips - [0.5, 0.0, 0.4]) @ NORMAL).max()
    assert drift[1] > 100 * drift[rigid_constraints.MOST_ROUNDS]


HANDLE = (
    "crank: {mechanism: hinge, xyz: [500 mm, 0, 400 mm], handle: [120 mm, 0, 0], "
    "inertia: 0.02 kg*m^2, knob: free, stop: -5 deg .. 5 deg}"
)
BLOCK = (
    "block: {shape: box, xyz: [500 mm, 0, 375 mm], size: [60 mm, 40 mm, 50 mm], free: true, "
    "mass: 1.5 kg}"
)
HELD = {
    "a mechanism": (HANDLE, "grasp: crank.handle", "[620 mm, 0, 400 mm]"),
    "a loose body": (BLOCK, "grasp: block", "[500 mm, 0, 400 mm]"),
    "nothing, measured at the wrist": ("", "sensor: {at: wrist}", "[500 mm, 0, 400 mm]"),
}


@pytest.mark.parametrize("held", HELD)
def test_it_holds_with_what_the_arm_holds(held):
    """A grip, the stop of a mechanism, a sensor at the wrist: the tip stays at its level."""
    world, robot, start = HELD[held]
    world = ", ".join(w for w in ("rail: {equation: 'z = 400 mm', stiffness: exact}", world) if w)
    pushed = Pushed(world, robot, start=start, damping=2)
    forces, tips = watched(pushed, [3.0, 10.0, -15.0], 300)
    assert np.abs(tips[:, 2] - 0.4).max() < 5e-8
    assert np.ptp(tips[:, 1]) > 1e-3
    assert np.abs(forces).max() > 5.0
    assert np.isfinite(pushed.plant.arm.wrench).all()


COUPLED = """
taskspec: 1
robot: {model: ./palletizer.urdf, start: {xyz: [600 mm, 100 mm, 560 mm]}}
world:
  level: {equation: z = 560 mm, stiffness: exact}
  side: {equation: "x - 0.5*y = 550 mm", stiffness: exact}
law: hybrid-multipliers
stages:
  press: {constraints: {level: {force: -10 N}}, axes: {y: {move: 40 mm}}, time: 1 s}
"""


def test_it_holds_an_arm_whose_joints_follow_others(tmp_path):
    """MuJoCo's constraints between the joints, and the exact ones, are solved for together."""
    shutil.copy(DATA / "palletizer.urdf", tmp_path)
    (tmp_path / "task.yaml").write_text(COUPLED)
    columns = run(load(tmp_path / "task.yaml"), tmp_path / "run").history.columns
    # By the joints that move by themselves: those that follow give way by as much under the weight.
    assert np.abs(columns["level.gap"]).max() < 1e-6
    assert np.abs(columns["side.gap"]).max() < 1e-6
    assert columns["level.lambda"][-1] == pytest.approx(-10.0, abs=0.1)
    assert columns["position.y"][-1] - columns["position.y"][0] == pytest.approx(0.04, abs=1e-3)


def test_the_summary_has_the_drift(tmp_path):
    found = run(load(TASKS / "exact-ring.yaml"), tmp_path / "run")
    columns, drift = found.history.columns, found.summary["drift"]
    assert [*drift] == ["rim", "level"]
    for name, most in drift.items():
        assert most["most"] == np.abs(columns[f"{name}.gap"]).max()
        assert 1e-13 < most["most"] < 1e-9
    assert "drift from rim: " in found.report.read_text()


def test_one_on_the_rotation_turns_the_tip_and_both_loops_agree(tmp_path):
    """The guide of a shipped task, without its springs: it turns the tool as it goes down."""
    text = (TASKS / "spiral-guide.yaml").read_text("utf-8")
    for spring in (
        "stiffness: 10 kN/m, damping: 30 N*s/m",
        "stiffness: 1 kN*m/rad, damping: 2 N*m*s/rad",
    ):
        assert text.count(spring) == 1
        text = text.replace(spring, "stiffness: exact")
    (tmp_path / "guide.yaml").write_text(text, "utf-8")
    task = load(tmp_path / "guide.yaml")
    found = {loop: run(task, tmp_path / loop, loop=loop) for loop in ("native", "python")}
    logs = [(tmp_path / loop / "log.arrow").read_bytes() for loop in found]
    assert logs[0] == logs[1]
    made = found["native"]
    assert made.passed
    columns = made.history.columns
    go = made.history.window("go")
    assert len(columns["clock"][go]) > 1000
    # The multipliers are the force along the spiral and the moment that levels the tool.
    assert np.abs(columns["spiral.lambda"][go] - 5.0).max() < 0.02
    assert np.abs(columns["level.lambda"][go] - 0.5).max() < 0.01
    assert np.abs(columns["spiral.gap"]).max() < 1e-10
    assert np.abs(columns["level.gap"]).max() < 1e-10
    # An angle is written as one.
    drift = made.summary["drift"]
    assert drift["spiral"]["text"].endswith("m")
    assert drift["level"]["text"].endswith("deg")


def test_one_on_joints_acts_on_them_alone():
    q = Pushed("").start
    offset = f"{float(q[0] - 2 * q[1])!r} rad"
    pushed = Pushed(f"tie: {{equation: 'q1 - 2*q2 = {offset}', stiffness: exact}}", damping=30)
    n = np.zeros(7)
    n[:2] = np.array([1.0, -2.0]) / np.sqrt(5)
    for _ in range(200):
        pushed.plant.step(10.0 * n)
    assert pushed.plant.views.equations[0] == pytest.approx(10.0, abs=1e-6)
    np.testing.assert_allclose(pushed.plant.arm.q, q, atol=1e-10)
    np.testing.assert_array_equal(pushed.plant.arm.wrench, 0.0)


def test_before_the_first_tick_the_arm_does_not_press():
    """It rests on its brakes, and no weight on the equation."""
    task = Pushed("").task
    pushed = Pushed(SLOPE.format(scale="1"))
    task = pushed.task.model_copy(
        update={"robot": pushed.task.robot.model_copy(update={"balanced": False})}
    )
    plant = Plant(pushed.robot, task, pushed.start)
    np.testing.assert_array_equal(plant.views.equations, 0.0)
    np.testing.assert_array_equal(plant.arm.wrench, 0.0)
