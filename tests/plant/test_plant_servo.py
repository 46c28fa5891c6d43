"""The joint servo of an arm that takes velocities or positions, against its closed form.

With e = r - q_m the reference obeys e'' + 2 zeta w e' + w^2 e = 0 while the commanded velocity z is
held, so that for zeta = 1 a step of z from rest gives e(t) = z t exp(-w t).
"""

from __future__ import annotations

import cmath
import math
from functools import cache

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from taskspec.control.servo import drive_gains, growth, highest_frequency, transition
from taskspec.robot import load_robot, solve_start
from taskspec.spec import LoadedTask, load_text
from taskspec_runner.plant.plant import Plant

Vector = NDArray[np.float64]

PANDA, PLANAR = "panda, start: {xyz: [500 mm, 0, 400 mm]}", "planar2"
#: Rates [Hz] of controller, servo and plant.
ALIKE, FINE, SLOW = (1000, 1000, 1000), (1000, 1000, 8000), (250, 1000, 2000)


@cache
def loaded(command: str, servo: str, rates: tuple[int, ...], model: str, rest: str) -> LoadedTask:
    control, own, plant = rates
    return load_text(
        f"taskspec: 1\nname: servo\nrobot: {{model: {model}, command: {command}, "
        f"servo: {{rate: {own} Hz, {servo}}}}}\n"
        f"control: {{rate: {control} Hz, plant_rate: {plant} Hz}}\n{rest}\n"
        "stages: {wait: {time: 1 s}}\n",
        "servo.yaml",
    )


class Served:
    """A plant with a servo, and what its joints did at every control tick."""

    def __init__(
        self,
        command: str = "velocity",
        servo: str = "delay: 0 ms",
        rates: tuple[int, ...] = ALIKE,
        model: str = PANDA,
        rest: str = "",
    ) -> None:
        task = loaded(command, servo, rates, model, rest)
        self.robot = load_robot(task.task.robot)
        begin = task.task.robot.start
        self.start = (
            self.robot.home
            if begin is None
            else solve_start(self.robot, begin.xyz, begin.rpy, begin.joints)
        )
        self.plant = Plant(self.robot, task.true_task, self.start)
        found = self.plant.arm.servo
        assert found is not None
        self.servo, self.period = found, 1.0 / rates[0]
        self.w = 2 * math.pi * task.true_task.robot.servo.bandwidth
        self.q, self.v = [self.plant.arm.q.copy()], [self.plant.arm.v.copy()]

    def __call__(self, command: Vector) -> None:
        self.plant.step(command)
        self.q.append(self.plant.arm.q.copy())
        self.v.append(self.plant.arm.v.copy())

    def joint(self, number: int) -> tuple[Vector, Vector]:
        """Displacements and velocities of a joint from 0 on."""
        q, v = np.array(self.q), np.array(self.v)
        return q[:, number] - self.start[number], v[:, number]

    def only(self, number: int, value: float) -> Vector:
        """A command of one joint, by velocity or away from the start."""
        command = self.start.copy() if self.servo.positions else np.zeros(len(self.start))
        command[number] += value
        return command


def test_it_holds_an_arm_where_it_starts():
    arm = Served()
    for _ in range(300):
        arm(np.zeros(7))
    assert np.abs(arm.plant.arm.q - arm.start).max() < 1e-12
    np.testing.assert_allclose(arm.servo.exerted, arm.plant.data.qfrc_bias, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("bandwidth", [5, 20, 60])
@pytest.mark.parametrize("rates", [ALIKE, FINE, SLOW], ids=["alike", "fine", "slow"])
def test_a_step_of_velocity_is_followed_as_in_the_closed_form(bandwidth, rates):
    arm, z = Served(servo=f"bandwidth: {bandwidth} Hz, delay: 0 ms", rates=rates), 0.2
    n = round(0.25 / arm.period)
    for _ in range(n):
        arm(arm.only(0, z))
    t = np.arange(n + 1) * arm.period
    displacement, rate = arm.joint(0)
    expected = z * t * (1 - np.exp(-arm.w * t))
    # The plant's Euler steps are off by a step of velocity, and an acceleration that is held for a
    # tick by a share of that of the tick.
    off = z / rates[2] + z * arm.w / rates[1] ** 2
    np.testing.assert_allclose(displacement, expected, atol=1.1 * off)
    exact = z - z * (1 - arm.w * t) * np.exp(-arm.w * t)
    np.testing.assert_allclose(rate, exact, atol=2.5 * arm.w * off)


@pytest.mark.parametrize("command", ["velocity", "position"])
@pytest.mark.parametrize("frequency", [2.0, 10.0, 25.0])
def test_frequency_response(command, frequency):
    """(2 zeta w s + w^2) / (s^2 + 2 zeta w s + w^2), behind the delay and a period of holding."""
    arm = Served(command, "bandwidth: 20 Hz, damping: 0.7, delay: 5 ms", FINE)
    turn, n = 2 * math.pi * frequency, 1000
    amplitude = 0.002
    for k in range(n):
        phase = turn * k * arm.period
        value = math.cos(phase) * turn if command == "velocity" else math.sin(phase)
        arm(arm.only(0, amplitude * value))
    displacement, _ = arm.joint(0)
    t = np.arange(n + 1) * arm.period
    whole = slice(n // 2, n)  # whole periods of all frequencies
    found = 2j * np.mean(displacement[whole] * np.exp(-1j * turn * t[whole])) / amplitude
    s, w = 1j * turn, arm.w
    rational = (1.4 * w * s + w**2) / (s**2 + 1.4 * w * s + w**2)
    # A command is reached at the end of its period: half of it for what is held, as z is.
    late = 0.005 + (arm.period / 2 if command == "velocity" else arm.period)
    held = np.sinc(frequency * arm.period) ** (1 if command == "velocity" else 2)
    expected = rational * held * cmath.exp(-s * late)
    assert abs(found - expected) < 0.015 * abs(expected)


@pytest.mark.parametrize("bandwidth", [10, 20])
def test_it_gives_way_to_a_force_by_its_inertia_and_bandwidth(bandwidth):
    """(H w^2)^-1 J^T f: what a force at the tip moves the joints by."""
    arm, force = Served(servo=f"bandwidth: {bandwidth} Hz"), np.array([0.5, -0.8, 1.0])
    _assert_gives_way(arm, force, lambda H: drive_gains(H, arm.w, 1.0, None)[0])


def test_it_gives_way_to_a_force_by_its_stiffness():
    stiffness = np.array([3000, 3000, 3000, 2500, 2500, 2000, 2000.0])
    listed = ", ".join(f"{each} N*m/rad" for each in stiffness)
    # At 1 kHz these drives would be unstable, as `growth` says: there are no rotors' inertias.
    servo = f"bandwidth: 50 Hz, stiffness: [{listed}]"
    arm = Served(servo=servo, rates=(1000, 4000, 4000))
    _assert_gives_way(arm, np.array([3.0, -4.0, 5.0]), lambda _: np.diag(stiffness))


def _assert_gives_way(arm: Served, force: Vector, stiffness: object) -> None:
    model, data = arm.plant.model, arm.plant.data
    body = model.body(arm.robot.tip_body).id
    for _ in range(600):
        data.xfrc_applied[body, :3] = force
        arm(np.zeros(7))
    H, J = np.zeros((model.nv, model.nv)), np.zeros((3, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, H)
    mujoco.mj_jac(model, data, J, None, data.xipos[body], body)
    expected = np.linalg.solve(stiffness(H), J.T @ force)
    assert np.abs(expected).max() > 1e-4
    moved = arm.plant.arm.q - arm.start
    np.testing.assert_allclose(moved, expected, atol=1e-6 * np.abs(expected).max())
    assert np.abs(arm.plant.arm.v).max() < 1e-6


@pytest.mark.parametrize("rates", [ALIKE, SLOW, (500, 1000, 1000)], ids=str)
@pytest.mark.parametrize("ticks", [0, 1, 7])
def test_commands_are_late_by_whole_ticks_of_the_servo(rates, ticks):
    arm = Served(servo=f"delay: {ticks} ms", rates=rates)
    prompt = Served(rates=rates)
    for _ in range(40):
        arm(arm.only(1, 0.1))
        prompt(prompt.only(1, 0.1))
    late = ticks * rates[0] / 1000
    shift = round(late)
    if late == shift:
        np.testing.assert_allclose(
            np.array(arm.q)[shift:], np.array(prompt.q)[: len(arm.q) - shift], atol=1e-12
        )
    first = int(np.argmax(np.abs(arm.joint(1)[1]) > 0))
    assert first == math.floor(late) + 1


def test_positions_and_velocities_are_one_where_the_one_is_the_sum_of_the_other():
    """A position is reached at the end of its period, as what a velocity is integrated to."""
    servo = "bandwidth: 15 Hz, delay: 3 ms"
    by_rate, by_place = Served("velocity", servo, SLOW), Served("position", servo, SLOW)
    place = by_place.start.copy()
    for k in range(200):
        rate = 0.1 * np.sin(0.05 * k + np.arange(7))
        place = place + by_rate.period * rate
        by_rate(rate)
        by_place(place)
    np.testing.assert_allclose(by_rate.q, by_place.q, atol=1e-12)
    assert np.abs(by_rate.joint(3)[0]).max() > 1e-3


def test_a_velocity_beyond_the_limit_is_the_limit_and_is_not_made_up_for():
    arm = Served(servo="delay: 0 ms, velocity: 0.3 rad/s")
    for k in range(1200):
        arm(arm.only(0, 5.0 if k < 500 else 0.0))
    displacement, rate = arm.joint(0)
    assert rate.max() == pytest.approx(0.3, rel=2e-3)
    assert rate[-1] == pytest.approx(0.0, abs=1e-9)
    assert displacement[-1] == pytest.approx(0.3 * 0.5, rel=0.05)


def test_the_robots_own_limit_of_velocity_holds_where_none_is_given():
    arm = Served()
    for _ in range(400):
        arm(arm.only(6, 50.0))
    assert arm.joint(6)[1].max() == pytest.approx(arm.robot.velocity_limit[6], rel=5e-3)


def test_acceleration_is_limited_and_the_velocity_does_not_overshoot():
    arm = Served(servo="delay: 0 ms, acceleration: 2 rad/s^2")
    for _ in range(600):
        arm(arm.only(0, 0.5))
    _, rate = arm.joint(0)
    change = np.diff(rate) / arm.period
    assert change.max() == pytest.approx(2.0, rel=1e-3)
    # As fast as that as long as it is far from what is commanded.
    assert np.interp(0.4, rate[:230], np.arange(230) * arm.period) == pytest.approx(0.2, rel=0.02)
    assert rate.max() < 0.5 * 1.001
    assert rate[-1] == pytest.approx(0.5, rel=1e-6)


def test_jerk_is_limited():
    arm = Served(servo="delay: 0 ms, acceleration: 2 rad/s^2, jerk: 40 rad/s^3")
    references = []
    for _ in range(400):
        arm(arm.only(0, 0.5))
        references.append(arm.servo.rate[0])
    acceleration = np.diff(references) / arm.period
    jerk = np.diff(acceleration) / arm.period
    assert np.abs(acceleration).max() == pytest.approx(2.0, rel=1e-6)
    assert np.abs(jerk).max() == pytest.approx(40.0, rel=1e-6)
    assert arm.joint(0)[1][-1] == pytest.approx(0.5, rel=1e-3)


def test_a_position_that_limits_kept_it_from_is_caught_up_with():
    arm = Served("position", "delay: 0 ms, velocity: 0.5 rad/s, acceleration: 50 rad/s^2")
    for _ in range(1000):
        arm(arm.only(0, 0.3))
    displacement, rate = arm.joint(0)
    assert rate.max() == pytest.approx(0.5, rel=5e-3)
    assert displacement[-1] == pytest.approx(0.3, abs=1e-9)


def _pushed_against_its_limit(command: str) -> tuple[Served, int]:
    """A joint pushed on for 300 ticks after it has come to its limit, and then taken back."""
    arm = Served(command, "delay: 0 ms", model=f"{PLANAR}, start: {{joints: [150 deg, 30 deg]}}")
    upper, rate = float(arm.robot.upper[0]), 0.5
    ahead = 0.0
    reached = round((upper - arm.start[0]) / rate / arm.period)
    back = reached + 300
    for k in range(back + 700):
        ahead += arm.period * rate * (1 if k < back else -1)
        arm(arm.only(0, ahead if command == "position" else rate * (1 if k < back else -1)))
    return arm, back


def test_the_drives_do_not_wind_up_at_a_joint_limit():
    """A velocity away from the limit is followed at once; behind it, motors have reached theirs."""
    arm, back = _pushed_against_its_limit("velocity")
    displacement, _ = arm.joint(0)
    upper = arm.robot.upper[0] - arm.start[0]
    assert displacement[back] == pytest.approx(upper, abs=0.02)
    left = int(np.argmax(displacement[back:] < upper - 0.01))
    # 20 ms of 0.5 rad/s, and what the drive's stiffness takes from full torque to none.
    stiffness = arm.w**2 * 0.33
    assert 0 < left * arm.period < 0.02 + 0.03 + arm.robot.torque_limit[0] / stiffness / 0.5


def test_commanded_positions_behind_a_joint_limit_have_to_come_back_first():
    arm, back = _pushed_against_its_limit("position")
    displacement, _ = arm.joint(0)
    upper = arm.robot.upper[0] - arm.start[0]
    left = int(np.argmax(displacement[back:] < upper - 0.01))
    # It was commanded for 300 ticks behind the limit, and comes back at the same rate.
    assert left == pytest.approx(300 + 20, abs=40)


def test_the_weight_of_a_payload_in_truth_is_not_carried():
    truth = "truth: {robot.payload: {mass: 500 g, xyz: [0, 30 mm, 20 mm]}}"
    known, heavy = Served(), Served(rest=truth)
    for _ in range(600):
        known(np.zeros(7))
        heavy(np.zeros(7))
    model, data = heavy.plant.model, heavy.plant.data
    body = model.body(heavy.robot.tip_body).id
    H, J, turning = np.zeros((7, 7)), np.zeros((3, 7)), np.zeros((3, 7))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, H)
    mujoco.mj_jacBody(model, data, J, turning, body)
    weight = np.array([0, 0, -0.5 * 9.81])
    lever = data.xmat[body].reshape(3, 3) @ np.array([0, 0.03, 0.02])
    expected = np.linalg.solve(heavy.w**2 * H, J.T @ weight + turning.T @ np.cross(lever, weight))
    np.testing.assert_allclose(heavy.plant.arm.q - heavy.start, expected, atol=1e-9)
    assert np.abs(known.plant.arm.q - known.start).max() < 1e-12


def test_friction_and_damping_of_joints_are_not_known():
    arm = Served(model=f"{PANDA}, joint_friction: 2 N*m, joint_damping: 1 N*m*s/rad")
    for _ in range(600):
        arm(arm.only(0, 0.2))
    behind = arm.servo.reference[0] - arm.plant.arm.q[0]
    H = np.zeros((7, 7))
    mujoco.mj_fullM(arm.plant.model, arm.plant.data, H)
    torque = (arm.w**2 * H @ (arm.servo.reference - arm.plant.arm.q))[0]
    assert behind > 0
    assert torque == pytest.approx(2.0 + 1.0 * 0.2, rel=0.02)


def test_a_counterweight_leaves_nothing_to_carry():
    arm = Served(model=f"{PANDA}, balanced: true")
    for _ in range(100):
        arm(np.zeros(7))
    assert np.abs(arm.servo.exerted).max() < 1e-12
    assert np.abs(arm.plant.arm.q - arm.start).max() < 1e-12


@pytest.mark.parametrize("model", [PANDA, PLANAR], ids=["panda", "planar2"])
@pytest.mark.parametrize("bandwidth", [40, 60, 100])
def test_it_is_stable_where_the_analysis_says_so(model, bandwidth):
    arm = Served(servo=f"bandwidth: {bandwidth} Hz", model=model)
    arm.plant.arm.v[0] = 0.05
    for _ in range(300):
        arm(np.zeros(len(arm.start)))
    assert np.abs(arm.plant.arm.v).max() < 1e-6


def test_it_is_unstable_beyond_it():
    most = highest_frequency(1.0, 1e-3) / (2 * math.pi)
    assert most == pytest.approx(131.8, abs=0.1)
    grown = []
    for share in (0.97, 1.03):
        arm = Served(servo=f"bandwidth: {share * most} Hz", model=PLANAR)
        arm.plant.arm.v[0] = 1e-6
        for _ in range(400):
            arm(np.zeros(2))
        grown.append(np.abs(arm.plant.arm.v).max() > 1e-6)
    assert grown == [False, True]


@pytest.mark.parametrize("ratio", [0.3, 0.7, 1.0, 2.0])
def test_the_boundary_is_where_the_sampled_loop_begins_to_grow(ratio):
    period, one = 1e-3, np.eye(1)
    most = highest_frequency(ratio, period)
    for share in (0.999, 1.001):
        K, D = drive_gains(one, share * most, ratio, None)
        assert (growth(one, K, D, period, 1) > 1) == (share > 1)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 1.7])
def test_the_transition_is_that_of_the_equation(ratio):
    """Many small steps of e'' + 2 zeta w e' + w^2 e = 0, by the midpoint rule."""
    w, period, n = 60.0, 4e-3, 20000
    motion = np.array([[0, 1], [-(w**2), -2 * ratio * w]]) * (period / n)
    one = np.eye(2)
    small = np.linalg.solve(one - motion / 2, one + motion / 2)
    expected = np.linalg.matrix_power(small, n)
    np.testing.assert_allclose(transition(w, ratio, period).reshape(2, 2), expected, rtol=1e-7)


def test_loose_bodies_and_mechanisms_do_not_count():
    rest = (
        "world: {lid: {shape: box, size: [40 mm, 40 mm, 40 mm], xyz: [700 mm, 0, 20 mm], "
        "free: true, mass: 2 kg}, floor: {shape: plane}, "
        "door: {mechanism: hinge, axis: [0, 0, 1], xyz: [0, 800 mm, 0], handle: [300 mm, 0, 0], "
        "inertia: 1 kg*m^2}}"
    )
    alone, among = Served(), Served(rest=rest)
    assert among.plant.model.nv > alone.plant.model.nv
    for _ in range(100):
        alone(alone.only(1, 0.1))
        among(among.only(1, 0.1))
    np.testing.assert_allclose(among.q, alone.q, atol=1e-12)
