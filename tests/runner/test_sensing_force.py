"""The force sensor in the loop: what reaches the controller of the wrench that the plant has."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from taskspec.spec import load_text
from taskspec_runner import read
from taskspec_runner.session import execute

PRESS = """
taskspec: 1
name: press
robot: {{model: planar2, start: {{xyz: [365 mm, 100 mm, 0]}}, sensor: {sensor}}}
world: {{wall: {{shape: plane, xyz: [370 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 5 kN/m}}}}
stages:
  reach: {{axes: {{x: {{velocity: 20 mm/s}}}}, until: force.x > 1 N, within: {{time: 2 s}}}}
  press: {{axes: {{x: {{force: 5 N}}}}, time: 0.5 s}}
"""


def press(sensor: str) -> str:
    return PRESS.format(sensor=sensor)


def test_the_default_is_the_force_of_the_step_before(simulate):
    run = simulate(press("{}"))
    # In the world's frame both are the same numbers, one row apart.
    np.testing.assert_array_equal(run["force.x.measured"][1:], run["force.x"][:-1])


@pytest.mark.parametrize(("delay", "ticks"), [("2 ms", 2), ("4.5 ms", 5)])
def test_a_delay_comes_on_top_of_the_one_tick(simulate, delay, ticks):
    run = simulate(press(f"{{delay: {delay}}}"))
    late = ticks + 1
    # The tool turns by 5 mrad at most from the measured tick to the one that it is used in.
    np.testing.assert_allclose(
        run["force.x.measured"][late:], run["force.x"][:-late], rtol=1e-2, atol=1e-12
    )
    sooner = run["force.x"][1 : 1 - late]
    assert not np.allclose(run["force.x.measured"][late:], sooner, rtol=1e-2)


def test_slow_samples_are_held(simulate):
    run = simulate(press("{rate: 250 Hz}"))
    measured = run["force.x.measured"]
    inside = np.flatnonzero(np.abs(measured) > 0.1)
    steps = np.flatnonzero(np.abs(np.diff(measured[inside])) > 1e-3)
    # What is held turns with the tool, by far less than a millinewton a tick.
    assert len(steps) > 20
    assert set(np.diff(steps) % 4) == {0}


def test_the_filter_smooths_and_the_bias_stays(simulate):
    """At the end everything rests: what is measured is the truth and the bias in tool axes."""
    run = simulate(
        press("{filter: 50 Hz, bias: [0, 0, 1 N, 0, 0, 0]}"), {"stages.press.time": "2 s"}
    )
    axis = run["joint.1.position"][-1] + run["joint.2.position"][-1]
    shown = run["force.x.measured"][-1] - run["force.x"][-1]
    # By the environment on the tool along its own z, the last link: the robot's is the opposite.
    assert shown == pytest.approx(-np.cos(axis), abs=1e-4)


def test_noise_has_the_declared_deviation(simulate):
    run = simulate(press("{noise: {force: 0.2 N, torque: 1 mN*m}}"))
    free = run.history.window("reach")
    free[np.flatnonzero(run["force.x"] > 0)[0] :] = False
    for axis in "xy":
        noise = run[f"force.{axis}.measured"][free]
        # The deviation of n samples is known to 1/sqrt(2 n); three times that.
        assert np.std(noise) == pytest.approx(0.2, rel=3 / np.sqrt(2 * noise.size))
        assert abs(noise.mean()) < 3 * 0.2 / np.sqrt(noise.size)
        assert abs(np.corrcoef(noise[1:], noise[:-1])[0, 1]) < 3 / np.sqrt(noise.size)


def test_a_seed_means_the_same_run(simulate):
    noisy, quiet = press("{noise: 0.1 N}"), press("{filter: 100 Hz}")

    def forces(text, seed):
        return simulate(text, seed=seed)["force.x.measured"]

    np.testing.assert_array_equal(forces(noisy, 3), forces(noisy, 3))
    assert not np.array_equal(forces(noisy, 3)[:200], forces(noisy, 4)[:200])
    np.testing.assert_array_equal(forces(quiet, 3), forces(quiet, 4))


def test_a_run_keeps_its_seed(tmp_path):
    """Same file and seed, same bytes; the seed is in the summary."""
    loaded = load_text(press("{noise: 0.1 N}"), "press.yaml")

    def left(name, seed):
        folder = execute(loaded, tmp_path / name, seed=seed, report=False).folder
        return [(folder / part).read_bytes() for part in ("log.arrow", "summary.json")]

    assert left("a", 7) == left("b", 7)
    assert left("c", 8)[0] != left("d", 7)[0]
    # With a sensor that draws nothing, seeds make no other ticks; the log says whose it is.
    loaded = load_text(press("{}"), "press.yaml")
    assert left("e", 7)[0] != left("f", 8)[0]
    e, f = (read(tmp_path / name).history for name in "ef")
    assert {n: c.tobytes() for n, c in e.columns.items()} == {
        n: c.tobytes() for n, c in f.columns.items()
    }


WRIST = """
taskspec: 1
name: wrist
robot:
  model: panda
  tool: {shape: cylinder, radius: 15 mm, length: 120 mm, mass: 800 g}
  start: {xyz: [450 mm, 0, 400 mm], rpy: [160 deg, 20 deg, 30 deg]}
  sensor: {at: wrist, bias: [1 N, -2 N, 3 N, 10 mN*m, 20 mN*m, -30 mN*m]}
stages:
  still: {tare: true, time: 1 s}
  tilt_it: {axes: {rx: {move: 40 deg}, ry: {move: -30 deg}, x: {move: 50 mm}}}
  rest: {time: 1 s}
"""


def six(run, stage, start):
    names = [*(f"force.{a}.measured" for a in "xyz"), *(f"torque.r{a}.measured" for a in "xyz")]
    return np.array([run.during(stage, name, start) for name in names])


def test_weight_is_taken_off_in_every_orientation(simulate):
    """Nothing touches: after the tare nothing is measured, however the tool has turned."""
    run = simulate(WRIST)
    rest = six(run, "rest", 0.8)
    # 7.8 N of weight; what is left is inertia of an arm that has all but settled.
    assert np.max(np.abs(rest[:3])) < 1e-3
    assert np.max(np.abs(rest[3:])) < 1e-4
    assert np.all(run["force.x"] == 0)


def test_before_the_tare_the_bias_is_what_is_left(simulate):
    run = simulate(WRIST)
    still = six(run, "still", 0.95)
    # Its size does not depend on the tool's axes.
    assert np.linalg.norm(still[:3], axis=0) == pytest.approx(np.sqrt(14.0), abs=1e-3)


@pytest.mark.parametrize("law", ["hybrid", "parallel", "impedance"])
def test_a_bias_moves_nothing_while_it_is_tared(simulate, law):
    """25 mN m / (h_m K) would turn the wrist of 3e-4 kg m^2 by a radian."""
    text = WRIST.replace("model: panda", "model: ur5e").replace("at: wrist, ", "")
    run = simulate(text.replace("stages:", f"law: {law}\nstages:"))
    turns = [run.during("still", f"position.r{a}", 0.0) for a in "xyz"]
    # Nothing acts on it: what is left is rounding.
    assert np.max(np.abs(turns)) < 1e-6


def test_while_it_moves_the_tools_inertia_is_left(simulate):
    """What the robot seems to apply is m a of the tool's centre of mass."""
    shaken = "shake: {axes: {x: {position: 500 mm + 20 mm * sin(2*pi*t/(0.5 s))}}, time: 2 s}"
    run = simulate(WRIST.replace("  rest:", f"  {shaken}\n  rest:"))
    robot = run.program.context.robot
    data, lever = robot.pin.createData(), robot.model.body(robot.tip_body).ipos
    rows = np.flatnonzero(run.history.window("shake"))[1000:]
    centers = []
    for row in rows:
        q = np.array([run[f"joint.{i + 1}.position"][row] for i in range(7)])
        pin.framesForwardKinematics(robot.pin, data, q)
        tip = data.oMf[robot.pin.getFrameId("tip")]
        centers.append(tip.translation + tip.rotation @ lever)
    x, period = np.array(centers)[:, 0], 1e-3
    expected = 0.8 * (x[2:] - 2 * x[1:-1] + x[:-2]) / period**2
    # Semi-implicit Euler: x[k+1] - 2 x[k] + x[k-1] is T^2 a[k], which is measured in row k + 1.
    measured = run["force.x.measured"][rows][2:]
    # The zero is off by 2e-4 N, and a rotation's second difference is no acceleration by w^2 T.
    np.testing.assert_allclose(measured, expected, atol=2e-3)
    assert np.max(np.abs(expected)) > 2.0


def test_a_later_tare_replaces_the_zero(simulate):
    text = WRIST.replace("stages:", "stages:\n  first: {tare: true, time: 1 s}")
    once, twice = simulate(WRIST), simulate(text)
    # If the second were added to the first, the bias would come back with the other sign.
    assert np.max(np.abs(six(twice, "rest", 0.8)[:3])) < 1e-3
    assert twice["clock"][-1] > once["clock"][-1]


def test_a_tare_of_the_plain_sensor_changes_nothing(simulate):
    plain = press("{}")
    tared = plain.replace("stages:", "stages:\n  zero: {tare: true, time: 50 ms}")
    run = simulate(tared)
    assert run.during("press", "force.x")[-1] == pytest.approx(
        simulate(plain).during("press", "force.x")[-1], abs=1e-3
    )
