"""Faults of `truth`: what each makes of what is shown, and that only the truth knows of it."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.compiler import compile_task
from taskspec.faults import ENCODER, KINDS, SENSOR, Shown, kinds_of
from taskspec.program.worlds import true_world
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError
from taskspec.text.units import ANGLE, ANGULAR_VELOCITY, FORCE, NUMBER, TIME, Quantity
from taskspec_runner.errors import InputError
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.fixed_step import NATIVE, run
from taskspec_runner.record.rows import RowKeeper
from taskspec_runner.sweep.world_run import run_world

PERIOD = 1e-3
PRESS = """
taskspec: 1
robot: {model: panda}
world: {table: {shape: plane, xyz: [0, 0, 486 mm], stiffness: 20 kN/m}}
frame: table
limits: {force: 60 N}
stages:
  approach: {axes: {z: {velocity: -30 mm/s}}, until: force.z < -2 N for 5 ms, within: {time: 2 s}}
  press: {axes: {z: {force: -10 N}}, time: 500 ms}
"""

HEAD_WITH_TYPO = """\
taskspec: 1
robot: {model: panda}
params: {push: 3 Newton}
stages: {wait: {time: 1 s}}
"""


def shown(word: str, size: Quantity, ticks: int, since: int = 5, every: float = 0.1) -> np.ndarray:
    """(ticks, 2, 2) of a device whose values and rates count ticks, spoiled from a tick on."""
    kind = KINDS[word](size, PERIOD, every, np.random.default_rng(1))
    found = []
    for tick in range(ticks):
        now = Shown(np.array([1.0, 10.0]) * tick, np.array([1.0, 10.0]), tick)
        if tick < since or kind.watches:
            kind.passes(now)
        if tick >= since:
            now.since = tick - since
            kind.spoil(now)
        found.append(now.vectors)
    return np.array(found)


NOTHING = Quantity(0.0, NUMBER)


@pytest.mark.parametrize(
    ("word", "size", "values", "rates"),
    [
        ("drops", NOTHING, [4, 40], [1, 10]),
        ("sticks", NOTHING, [4, 40], [0, 0]),
        ("lost", NOTHING, [0, 0], [0, 0]),
        ("bias", Quantity(3.0, ANGLE), [12, 93], [1, 10]),
        ("bias", Quantity(3.0, ANGULAR_VELOCITY), [9, 90], [4, 13]),
        # Four ticks of 1 ms.
        ("drifts", Quantity(1000.0, ANGULAR_VELOCITY), [13, 94], [1001, 1010]),
        ("gain", Quantity(0.5, NUMBER), [4.5, 45], [0.5, 5]),
        ("flips", NOTHING, [-9, -90], [-1, -10]),
        ("swaps", NOTHING, [90, 9], [10, 1]),
        ("late", Quantity(2e-3, TIME), [7, 70], [1, 10]),
        ("spikes", Quantity(3.0, ANGLE), [9, 90], [1, 10]),
    ],
)
def test_what_is_shown_four_ticks_later(word, size, values, rates):
    found = shown(word, size, 10)
    np.testing.assert_array_equal(found[4], [[4, 40], [1, 10]])
    np.testing.assert_allclose(found[9], [values, rates], rtol=1e-12)


def test_spikes_come_again():
    found = shown("spikes", Quantity(3.0, FORCE), 20, every=4e-3)[:, 0, 0] - np.arange(20)
    assert np.flatnonzero(found).tolist() == [5, 9, 13, 17]


def test_clips():
    found = shown("clips", Quantity(20.0, FORCE), 10)
    np.testing.assert_array_equal(found[9, 0], [9, 20])


def test_noise_has_its_deviation():
    found = shown("noise", Quantity(2.0, FORCE), 20_005)[5:, 0] - np.outer(
        np.arange(5, 20_005), [1, 10]
    )
    # The deviation of n numbers is known to about s / sqrt(2 n); 5 of them.
    assert np.std(found) == pytest.approx(2.0, abs=5 * 2.0 / np.sqrt(2 * found.size))


def test_what_fails_at_once_shows_what_is():
    found = shown("sticks", NOTHING, 4, since=0)
    np.testing.assert_array_equal(found[:, 0], [[0, 0]] * 4)
    assert shown("drops", NOTHING, 4, since=0)[3, 1].tolist() == [1, 10]


def test_every_kind_has_examples_that_load():
    for device in (SENSOR, ENCODER, "torque"):
        channels = {SENSOR: "axis: [x, z]"}.get(device, "joint: [1, 2]")
        for word, kind in kinds_of(device).items():
            text = f"{word} {kind.examples.get(device, '')}".strip()
            task = f"{PRESS}truth: {{faults: [{{{device}: {text}, {channels}}}]}}\n"
            (fault,) = load_text(task, "task.yaml").task.truth.faults
            assert fault.text.endswith(text)
            assert len(fault.channels((True,) * 7)) == 2


@pytest.mark.parametrize("channels", ["axis: z", "axis: [x, q]", "axis: [[x]]", "joint: 3"])
@pytest.mark.parametrize("effect", ["bias push", "gain push", "drifts push/s", "clips push"])
@pytest.mark.parametrize("device", ["sensor", "torque", "encoder"])
def test_a_typo_in_a_param_that_a_fault_uses_is_reported(device, effect, channels):
    """The fault cannot be read for it, and is not looked into any further."""
    text = HEAD_WITH_TYPO + f"truth: {{faults: [{{{device}: {effect}, {channels}}}]}}\n"
    with pytest.raises(SpecError) as caught:
        load_text(text, "t.yaml")
    found = {d.code: d for d in caught.value.diagnostics}
    assert "'Newton' is not a unit" in found["TS111"].message
    assert found["TS111"].span is not None
    assert (found["TS111"].span.line, found["TS111"].span.column) == (3, 18)


def test_a_controller_is_not_told(simulate):
    """Up to the fault a run is what it is without; a sensor's fault leaves no mark before."""
    good = simulate(PRESS)
    bad = simulate(PRESS + "truth: {faults: [{sensor: lost, stage: press, at: 0.2 s}]}\n")
    at = int(np.flatnonzero(good.history.window("press"))[0]) + 200
    for name, column in good.history.columns.items():
        np.testing.assert_array_equal(column[:at], bad[name][:at], err_msg=name)
    assert np.abs(bad["force.z.measured"][at:]).max() == 0.0
    assert np.abs(bad["force.z"][at:]).min() > 9.0


def test_true_and_measured_of_an_encoder(simulate):
    """The log has both, and the tip is truly where true joints put it."""
    faults = "{encoder: bias 0.5 deg, joint: 2, stage: press, at: 0.2 s}"
    run = simulate(f"{PRESS}truth: {{faults: [{faults}]}}\n")
    q, measured = run["joint.2.position"], run["joint.2.position.measured"]
    at = int(np.flatnonzero(run.history.window("press"))[0]) + 200
    np.testing.assert_array_equal(q[:at], measured[:at])
    np.testing.assert_allclose(measured[at:] - q[at:], np.radians(0.5), rtol=1e-9)
    # The gap is to the true table; a ball that tilts has its tip above its lowest point.
    radius = float(np.linalg.norm(run.program.context.robot.tool.centers[0]))
    above = radius * (1.0 - np.cos(run["tilt"]))
    np.testing.assert_allclose(run["position.z"], run["gap"] + above, atol=1e-9)
    assert np.abs(run["position.z.measured"] - run["gap"])[at:].min() > 1e-3


def test_true_torque_stands_beside_the_command(simulate):
    faults = "{torque: gain 0.5, joint: 4, stage: press, at: 0.2 s, for: 100 ms}"
    run = simulate(f"{PRESS}truth: {{faults: [{faults}]}}\n")
    at = int(np.flatnonzero(run.history.window("press"))[0]) + 200
    share = run["joint.4.torque.exerted"] / run["joint.4.torque"]
    np.testing.assert_allclose(share[at : at + 100], 0.5, rtol=1e-12)
    assert (share[:at] == 1.0).all()
    assert (share[at + 100 :] == 1.0).all()


def test_noise_of_torques_is_not_that_of_the_sensor(simulate):
    """Devices are noisy each for itself: a correlation would look like physics."""
    sensor = PRESS.replace("panda}", "panda, sensor: {noise: {force: 1 N}}}").replace("486", "400")
    run = simulate(f"{sensor}truth: {{faults: [{{torque: noise 1 N*m}}]}}\n")
    free = slice(0, 300)
    force = np.array([run[f"force.{axis}.measured"][free] for axis in "xyz"])
    torque = np.array(
        [run[f"joint.{i}.torque.exerted"] - run[f"joint.{i}.torque"] for i in range(1, 8)]
    )[:, free]
    assert force.std(axis=1) == pytest.approx(1.0, rel=0.15)
    assert torque.std(axis=1) == pytest.approx(1.0, rel=0.15)
    for lag in (0, 1):
        found = np.corrcoef(force[:, lag:], torque[:, : torque.shape[1] - lag])[:3, 3:]
        # 21 pairs of independent noise: four deviations of a correlation of 300 ticks.
        assert np.abs(found).max() < 4 / 300**0.5


@pytest.mark.parametrize(("device", "more"), [("sensor", ""), ("encoder", ", joint: 2")])
def test_silence_is_borne_for_a_while(simulate, device, more):
    short = f"truth: {{faults: [{{{device}: drops{more}, at: 0.4 s, for: 20 ms}}]}}\n"
    assert simulate(PRESS + short).outcome.reason != f"{device}_lost"
    long = f"truth: {{faults: [{{{device}: drops{more}, at: 0.4 s}}]}}\n"
    outcome = simulate(PRESS + long).outcome
    assert (outcome.status, outcome.reason) == ("stopped", f"{device}_lost")
    assert outcome.clock == pytest.approx(0.420)
    assert "20 ms" in outcome.text
    patient = simulate(f"{PRESS}control: {{timeout: 50 ms}}\n{long}").outcome
    assert patient.clock == pytest.approx(0.450)


def test_motors_exert_no_more_than_they_can(simulate):
    run = simulate(f"{PRESS}truth: {{faults: [{{torque: gain 100, joint: 2, at: 0.4 s}}]}}\n")
    limit = run.program.context.robot.torque_limit[1]
    assert np.abs(run["joint.2.torque.exerted"]).max() == limit
    assert np.isfinite(run["joint.2.velocity"]).all()


def test_a_joint_that_there_is_not():
    with pytest.raises(SpecError, match="counted from 1"):
        load_text(PRESS + "truth: {faults: [{torque: lost, joint: 0}]}\n", "task.yaml")


def test_worlds_of_a_sweep_have_the_faults():
    """Whatever loop serves other worlds."""
    task = f"{PRESS}truth: {{faults: [{{sensor: drops, at: 0.4 s}}]}}\n"
    program = compile_task(load_text(task, "task.yaml"))
    row = run_world(program, 0, true_world(program.context), NATIVE)
    assert (row["status"], row["reason"]) == ("stopped", "sensor_lost")


def test_who_wants_machine_code_is_told():
    task = f"{PRESS}truth: {{faults: [{{sensor: drops, at: 0.4 s}}]}}\n"
    parts = assemble(compile_task(load_text(task, "task.yaml")))
    with pytest.raises(InputError, match="faults"):
        run(parts.machine, parts.plant, parts.bus, RowKeeper(parts.bus), PERIOD,
            loop=NATIVE, faults=parts.faults)  # fmt: skip
