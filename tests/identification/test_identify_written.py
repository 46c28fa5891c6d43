"""What a file gets of identified values: intervals that noise makes, and none of arithmetic."""

from __future__ import annotations

from pathlib import Path

import pytest

from hidden_worlds import press, program, run
from taskspec.spec import load_text
from taskspec.spec.patch import patched
from taskspec_runner.identify import Identification, identify
from taskspec_runner.identify.written import file_values, tolerances, values

NOISE = "{noise: {force: 0.15 N, torque: 8 mN*m}}"
HIDDEN = {
    "world.bench.stiffness": "21.97 kN/m",
    "world.bench.xyz": "[0, 0, 299.3 mm]",
    "world.bench.rpy": "[0.5 deg, 0.4 deg, 0]",
    "robot.sensor.delay": "3 ms",
}


def _found(sensor: str) -> Identification:
    _, history = run(press(sensor), HIDDEN, seed=3)
    return identify(program(press(sensor)), [history])


@pytest.fixture(scope="module")
def noiseless() -> Identification:
    return _found("{}")


@pytest.fixture(scope="module")
def noisy() -> Identification:
    return _found(NOISE)


def test_without_noise_nothing_varies(noiseless: Identification) -> None:
    """Payload, joint friction and bias are 0 in file and world: known, and without an interval."""
    names = {each.name for each in noiseless.estimates}
    assert {"robot.payload.mass", "robot.joint_friction", "robot.sensor.bias.2"} <= names
    assert {"world.bench.stiffness", "world.bench.rpy.0", "robot.sensor.delay"} <= names
    assert tolerances(noiseless) == {}
    made = load_text(patched(noiseless.loaded.source.text, file_values(noiseless)), "made.yaml")
    assert not made.task.vary
    assert made.task.shapes["bench"].stiffness == pytest.approx(21970)


def test_a_turned_plane_is_written_as_it_is_estimated(noiseless: Identification) -> None:
    """The yaw of a plane is not identified, and stays 0 in the file."""
    assert values(noiseless)["world.bench.rpy"] == "[0.5 deg, 0.4 deg, 0]"


def test_noise_of_the_sensor_makes_no_interval_of_what_exact_torques_say(
    noisy: Identification,
) -> None:
    """The torques of this log are without noise: what they decide is exact, the contact is not."""
    exact = {each.name for each in noisy.estimates if each.exact}
    assert {"robot.payload.mass", "robot.joint_friction", "robot.joint_damping"} <= exact
    assert not any(name.startswith(("world.", "robot.sensor.bias")) for name in exact)
    vary = tolerances(noisy)
    assert {"world.bench.stiffness", "world.bench.friction", "robot.sensor.bias"} <= set(vary)
    assert not any(path.startswith(("robot.payload", "robot.joint_")) for path in vary)


def test_the_command_writes_no_interval_of_a_log_without_noise(tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from taskspec_runner.cli.app import app

    file, folder, out = tmp_path / "press.yaml", tmp_path / "run", tmp_path / "out.yaml"
    file.write_text(press(), encoding="utf-8")
    runner = CliRunner()
    hidden = ["--set", "truth.world.bench.stiffness=24 kN/m", "--quiet"]
    assert runner.invoke(app, ["run", str(file), "--out", str(folder), *hidden]).exit_code == 0
    what = ["--what", "world.bench,robot.payload", "--patch", str(out)]
    done = runner.invoke(app, ["identify", str(file), str(folder), *what])
    assert done.exit_code == 0, done.output
    text = out.read_text(encoding="utf-8")
    assert "stiffness: 24 kN/m" in text
    assert "vary" not in text
