"""The referee of benchmarks/referee: its measures against closed forms, laws in a short task."""

from __future__ import annotations

import json
import sys

import numpy as np
import pinocchio as pin
import pytest
from meeting import ROOT, Serving, log_bytes, program_of, shipped

from taskspec_runner.link.server import ServerOptions

sys.path.insert(0, str(ROOT / "benchmarks"))
from bench_referee import FORWARD_TUNED, ROS_TUNED, RUB, page
from referee.admittance import AdmittanceGains, RosAdmittance
from referee.arm import Arm
from referee.direct import driven
from referee.forward_dynamics import KEPT, STEP, ComplianceGains, ForwardDynamics
from referee.impedance import Impedance
from referee.metrics import BAND, metrics
from referee.operational_space import OperationalSpace
from referee.rebuilt import model_of
from referee.session import Sample, Session
from referee.tuning import NEAR, cost, forward_gains, ros_gains, tuned

TIME = np.arange(5000) * 1e-3
#: The wipe, cut short, and without friction.
WIPE = shipped("wipe-table").read_text("utf-8").replace("time: 8 s", "time: 1 s")
WIPE = WIPE.replace(", friction: 0.2}", "}").replace("  world.table.friction: 0..0.5\n", "")


def test_a_step_that_decays_is_measured_as_its_closed_form():
    """f = F (1 - e^(-t/T)) is within b F from T ln(1/b) on."""
    found = metrics(
        TIME, -20 * (1 - np.exp(-TIME / 0.3)), np.full(5000, -20.0), np.zeros((5000, 1))
    )
    assert found.settled == pytest.approx(0.3 * np.log(1 / BAND), abs=2e-3)
    assert found.overshoot == 0
    # The integral of (F e^(-t/T))^2 over 5 s is F^2 T/2.
    assert found.force_rms == pytest.approx(20 * np.sqrt(0.3 / 2 / 5), rel=5e-3)
    # e^(-t/T) > 1 - 0.1/20 in the first T 0.1/20.
    assert found.lost == pytest.approx(0.3 * 0.1 / 20 / 5, abs=3e-4)
    assert found.path_rms == 0


def test_an_overshoot_a_ramp_and_a_force_that_never_settles():
    ringing = 10 * (1 - np.exp(-TIME) * np.cos(2 * np.pi * TIME))
    found = metrics(TIME, ringing, np.full(5000, 10.0), np.zeros((5000, 0)))
    assert found.overshoot == pytest.approx(10 * np.exp(-0.5), rel=0.03)
    ramp = np.minimum(TIME / 0.5, 1.0) * 10
    late = metrics(TIME, ramp - 2.0, ramp, np.zeros((5000, 0)))
    assert (late.settled, late.force_rms) == (float("inf"), pytest.approx(2.0))


def test_the_error_along_a_path_is_of_all_led_axes():
    off = np.column_stack([3e-3 * np.sin(2 * np.pi * TIME), 4e-3 * np.cos(2 * np.pi * TIME)])
    found = metrics(TIME, np.full(5000, 5.0), np.full(5000, 5.0), off)
    assert found.path_rms == pytest.approx(np.sqrt((3e-3**2 + 4e-3**2) / 2), rel=1e-6)


@pytest.mark.parametrize("law", ["impedance", "operational space"])
def test_a_law_of_others_comes_to_the_end_and_presses(law, tmp_path):
    """Without friction a force that is fed forward comes, but for what the motion takes.

    The impedance does not know the inertia: 0.3 m/s^2 of motion on some 4 kg are 1.2 N at most.
    """
    file = tmp_path / "wipe.yaml"
    file.write_text(WIPE, "utf-8")
    arm = Arm(file)
    made = Impedance(arm, 5.0) if law == "impedance" else OperationalSpace(arm, 987.0, coupled=True)
    with Serving(WIPE, tmp_path / "run", ServerOptions(wait=60.0, answer=30.0)) as serving:
        said = Session(serving.port, law).drive(made)
        run = serving.run
    assert "led to end" in said
    assert run.summary["link"]["name"] == law
    assert run.summary["link"]["clipped"] == 0
    force = np.asarray(run.during("wipe").signals["force.z"])
    assert np.abs(force[500:] + 15).max() < 1.2


@pytest.mark.parametrize("task", ["wipe-table", "own-robot"])
def test_an_arm_that_is_described_is_the_same_arm(task):
    """What is sent to another Pinocchio has the same inertia, bias and tip."""
    arm = Arm(shipped(task))
    said = json.loads(json.dumps(arm.described()))
    model, random = model_of(said), np.random.default_rng(3)
    data, own = model.createData(), arm.model.createData()
    for _ in range(5):
        q, v = random.uniform(-1, 1, (2, model.nv))
        M = pin.crba(model, data, q)
        assert np.triu(M) == pytest.approx(np.triu(arm.inertia(q)), abs=1e-12)
        assert pin.rnea(model, data, q, v, 0 * v) == pytest.approx(arm.bias(q, v), abs=1e-11)
        pin.forwardKinematics(model, data, q)
        pin.framesForwardKinematics(arm.model, own, q)
        tip = data.oMi[said["tip_joint"]].homogeneous @ np.array(said["tip"])
        assert tip == pytest.approx(own.oMf[arm.tip].homogeneous, abs=1e-12)


PERIOD = 1e-3
PUSH = 5.0
#: The task that gains are tuned on, cut short; and the arm of it.
SHORT = RUB.read_text("utf-8").replace("time: 2 s", "time: 0.5 s")
RUBBING = Arm(RUB)


def sample_at_rest(force: np.ndarray, frame: np.ndarray | None = None) -> Sample:
    """The arm stands where its reference is, and the robot is commanded a wrench (6,)."""
    q = RUBBING.robot.home
    R, p = RUBBING.tip_at(q)
    none = np.zeros(6)
    extras = {
        "tip": p,
        "tip_rotation": R.T.ravel(),
        "jacobian": RUBBING.jacobian(q).T.ravel(),
        "frame": (np.eye(3) if frame is None else frame).T.ravel(),
        **dict.fromkeys(("position", "position_ref", "velocity", "velocity_ref", "force"), none),
        "force_ref": force,
    }
    return Sample(1, 0.0, q, np.zeros(7), extras)


def twist_after(law: RosAdmittance | ForwardDynamics, sample: Sample, ticks: int) -> np.ndarray:
    """(6,) of the tip that is commanded after so many of the same sample."""
    assert ticks > 0
    for _ in range(ticks):
        command = law.command(sample)
    return np.asarray(sample.jacobian @ command)


def admits(**changed: object) -> RosAdmittance:
    """The rule of ROS 2 without springs, filter and loss in the inverse."""
    six = {"mass": (2.0,) * 6, "damping_ratio": (3.0,) * 6, "stiffness": (0.0,) * 6}
    gains = {**six, "filter_coefficient": 1.0, "alpha": 1e-9, **changed}
    return RosAdmittance(RUBBING, AdmittanceGains(**gains), PERIOD)


def test_an_axis_without_a_spring_has_no_damper_but_that_of_the_joints():
    """v' = F / M - d v by semi-implicit Euler, whatever the ratio is."""
    moved = twist_after(admits(), sample_at_rest(np.array([0, 0, PUSH, 0, 0, 0])), 2000)
    assert moved[2] == pytest.approx(PUSH / 2.0 / 5.0 * (1 - (1 - 5.0 * PERIOD) ** 2000), rel=1e-4)
    assert np.abs(np.delete(moved, 2)).max() < 1e-6


def test_a_mass_is_not_turned_with_the_frame_that_its_axis_is_of():
    turned = pin.exp3(np.array([np.pi / 2, 0, 0]))
    law = admits(mass=(1.0, 2.0, 10.0, 1.0, 1.0, 1.0))
    pushed = sample_at_rest(np.array([0, 0, PUSH, 0, 0, 0]), turned)
    # The frame's z is the world's -y.
    assert twist_after(law, pushed, 1)[1] == pytest.approx(-PERIOD * PUSH / 2.0, rel=1e-5)


def test_the_wrench_is_filtered_by_a_share_of_each_sample():
    law = admits(filter_coefficient=0.05, joint_damping=0.0)
    pushed = sample_at_rest(np.array([0, 0, PUSH, 0, 0, 0]))
    rates = [twist_after(law, pushed, 1)[2] for _ in range(3)]
    wanted = np.cumsum(1 - 0.95 ** np.arange(1, 4)) * PERIOD * PUSH / 2.0
    assert rates == pytest.approx(wanted, rel=1e-5)


def test_an_axis_that_is_not_selected_feels_no_force():
    law = admits(selected_axes=(True, True, False, True, True, True))
    moved = twist_after(law, sample_at_rest(np.array([PUSH, 0, PUSH, 0, 0, 0])), 5)
    assert moved[0] > 1e-3
    assert abs(moved[2]) < 1e-9


def falls(**changed: object) -> ForwardDynamics:
    """Forward dynamics without springs, with links that weigh nothing."""
    gains = {"stiffness": (0.0,) * 6, "p": (0.05,) * 6, "d": (0.0,) * 6, "link_mass": 1e-6}
    positions = bool(changed.pop("positions", False))
    compliance = ComplianceGains(**{**gains, **changed})
    return ForwardDynamics(RUBBING, compliance, PERIOD, positions=positions)


@pytest.mark.parametrize("ticks", [1, 10, 200])
def test_forward_dynamics_yields_like_a_damper_behind_a_lag_of_its_periods(ticks):
    """v = 0.9 (v + h p F / 1 kg), in each period."""
    moved = twist_after(falls(), sample_at_rest(np.array([0, 0, PUSH, 0, 0, 0])), ticks)
    settled = KEPT / (1 - KEPT) * STEP * 0.05 * PUSH
    assert settled == pytest.approx(0.18 * 0.05 * PUSH)
    assert moved[2] == pytest.approx(settled * (1 - KEPT**ticks), rel=2e-3)


def test_on_positions_a_command_is_a_virtual_step_ahead_of_the_joints():
    pushed = sample_at_rest(np.array([0, 0, PUSH, 0, 0, 0]))
    velocity = falls().command(pushed)
    law = falls(positions=True)
    assert law.command(pushed) == pytest.approx(pushed.q)
    assert law.command(pushed) - pushed.q == pytest.approx(STEP * velocity, rel=1e-6)


def test_a_derivative_of_forces_is_by_the_virtual_step_not_the_period():
    """A force that has just come is divided by 20 ms, though it came in 1 ms."""
    pushed = sample_at_rest(np.array([0, 0, PUSH, 0, 0, 0]))
    with_d = twist_after(falls(d=(0.01,) * 6), pushed, 1)[2]
    assert with_d == pytest.approx(KEPT * STEP * PUSH * (0.05 + 0.01 / STEP), rel=2e-3)


@pytest.mark.parametrize("name", ["ROS 2", "forward dynamics"])
def test_a_rule_that_is_tuned_presses_and_follows(name, tmp_path):
    """By velocities, through the servo; by UDP and at hand it leaves the same log."""

    def made() -> RosAdmittance | ForwardDynamics:
        if name == "ROS 2":
            return RosAdmittance(RUBBING, ros_gains(ROS_TUNED), PERIOD)
        return ForwardDynamics(RUBBING, forward_gains(FORWARD_TUNED), PERIOD)

    with Serving(SHORT, tmp_path / "run", ServerOptions(wait=60.0, answer=30.0)) as serving:
        said = Session(serving.port, name).drive(made())
        run = serving.run
    assert "led to end" in said
    force = np.asarray(run.during("rub").signals["force.z"])
    assert np.abs(force[400:] + 12).max() < 1.2
    taken = driven(made(), name, program_of(SHORT), tmp_path / "at hand")
    assert len(taken) > 500
    assert log_bytes(run) == (tmp_path / "at hand" / "log.arrow").read_bytes()


def test_tuning_keeps_to_its_budget_and_its_bounds_and_finds_what_is_better():
    space, tried = {"a": (0.1, 10.0), "b": (1.0, 1e4)}, []

    def price(at: dict[str, float]) -> float:
        tried.append(at)
        return float(np.log(at["a"] / 2) ** 2 + np.log(at["b"] / 300) ** 2)

    best, least = tuned(space, price, anywhere=30, about=30, seed=3)
    assert len(tried) == 60
    assert all(low <= at[key] <= high for at in tried for key, (low, high) in space.items())
    assert least == pytest.approx(price(best))
    assert least < min(price(at) for at in tried[:30])
    assert least < NEAR**2


def test_a_run_that_ends_early_costs_more_than_one_that_never_settles():
    wanted = np.full(5000, -12.0)
    poor = metrics(TIME, wanted + 2.0, wanted, np.full((5000, 1), 1e-3))
    good = metrics(TIME, wanted + 0.1, wanted, np.full((5000, 1), 1e-4))
    prices = [cost(each, -12.0, ended=True) for each in (good, poor)]
    assert prices[0] == pytest.approx(0.1 / 0.6 + 0.1)
    assert prices[0] < prices[1] < cost(None, -12.0, ended=True)
    assert cost(good, -12.0, ended=False) == cost(None, -12.0, ended=False)


def test_a_page_keeps_the_tables_that_are_not_made_anew():
    first = page({"torque": "old torques\n", "velocity": "old velocities\n"}, "")
    second = page({"velocity": "new velocities\n"}, first)
    assert "old torques" in second
    assert "new velocities" in second
    assert "old velocities" not in second
    assert page({}, second) == second
