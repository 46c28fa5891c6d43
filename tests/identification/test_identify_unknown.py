"""What logs do not tell, what they do not tell apart, and logs that cannot be used."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hidden_worlds import SWING, press, program, run
from taskspec.spec import load_text
from taskspec.spec.patch import PatchError, patched
from taskspec_runner.errors import InputError
from taskspec_runner.identify import Identification, identify
from taskspec_runner.identify.written import file_values, set_lines
from taskspec_runner.record.history import History

NOISE = "{noise: {force: 0.15 N, torque: 8 mN*m}}"


def _pressing(history: History) -> History:
    """The ticks in which a run presses alone."""
    on = (history.stages == "press") & (history.columns["t"] > 0.6)
    columns = {name: values[on] for name, values in history.columns.items()}
    return replace(history, columns=columns, stages=history.stages[on], rest=None)


def test_a_bias_and_a_place_are_not_told_apart_without_free_motion() -> None:
    """A steady press shows k (o - z) + c: of a place o and a bias c only k o + c is known."""
    text = press(NOISE).replace(" - 6 N*sin(2*pi*t/(0.4 s))", "")
    text = text.replace("friction: 0.2", "friction: 0")
    for speed in ("30", "20"):
        text = text.replace(f"{speed} mm/s*sin", "0 mm/s*sin")
    _, history = run(text, {"robot.sensor.bias": "[0, 0, 1 N, 0, 0, 0]"})
    what = ["world.bench.xyz", "robot.sensor.bias"]
    found = identify(program(text), [_pressing(history)], what)
    place, bias = "world.bench.xyz.2", "robot.sensor.bias.2"
    group = next(group for group in found.confounded if place in group.names)
    assert bias in group.names
    known = next(each for each in group.known if {place, bias} <= set(each.coefficients))
    ratio = known.coefficients[bias] / known.coefficients[place]
    # The tool's z points down: 1 N along it counts as a surface that is lower by 1 N / k.
    assert ratio == pytest.approx(-1 / 15e3, rel=1e-3)
    truth = sum(
        factor * {place: 0.3, bias: 1.0}.get(name, 0.0)
        for name, factor in known.coefficients.items()
    )
    spread = (known.high - known.low) / 2
    # Twice the half width of the 90 % interval are 3.3 standard deviations.
    assert abs(known.value - truth) < 2 * spread
    assert spread < 1e-5
    whole = identify(program(text), [history], what)
    apart = whole.estimate(bias)
    assert abs(apart.value - 1.0) < 4 * apart.deviation
    assert apart.deviation < 0.05


def test_no_contact_in_the_log() -> None:
    """What is not touched is not identified, and is named."""
    text = SWING + "world: {far: {shape: plane, xyz: [0, 0, 0]}}\n"
    _, history = run(text, {"robot.payload.mass": "200 g"})
    found = identify(program(text), [history])
    assert {"world.far.stiffness", "world.far.friction", "world.far.xyz.2"} <= set(found.unseen)
    assert found.estimate("robot.payload.mass").value == pytest.approx(0.2, rel=1e-6)


def test_a_log_of_another_arm() -> None:
    _, history = run(press(), {})
    other = press().replace("ur5e", "panda")
    with pytest.raises(InputError, match="6 joints, and the file's robot 'panda' has 7"):
        identify(program(other), [history])


def test_a_log_of_another_task() -> None:
    _, history = run(SWING, {})
    with pytest.raises(InputError, match="stage 'swing', which the file does not"):
        identify(program(press()), [history])


@pytest.mark.parametrize(
    ("path", "hint"),
    [
        ("world.bench.stifness", "did you mean 'world.bench.stiffness'"),
        ("world.table.stiffness", "did you mean 'world.bench.stiffness'"),
        ("robot.model", "values that can be identified"),
    ],
)
def test_a_path_that_names_nothing(path: str, hint: str) -> None:
    _, history = run(press(), {})
    with pytest.raises(InputError) as caught:
        identify(program(press()), [history], [path])
    assert f"--what: '{path}'" in str(caught.value)
    assert hint in str(caught.value)


def test_a_frame_stands_for_the_pose_of_what_it_is_on() -> None:
    _, history = run(press(), {"world.bench.xyz": "[0, 0, 301 mm]"})
    found = identify(program(press()), [history], ["frames.task"])
    assert {e.path for e in found.estimates} <= {"world.bench.xyz", "world.bench.rpy"}
    assert found.estimate("world.bench.xyz.2").value == pytest.approx(0.301, abs=1e-8)


@pytest.fixture(scope="module")
def noisy() -> Identification:
    truth = {
        "world.bench.stiffness": "24 kN/m",
        "world.bench.xyz": "[0, 0, 299 mm]",
        "robot.payload": "{mass: 200 g, xyz: [0, 0, 20 mm]}",
        "robot.sensor.delay": "3 ms",
    }
    _, history = run(press(NOISE), truth, seed=3)
    return identify(program(press(NOISE)), [history])


def test_intervals_grow_with_their_level(noisy: Identification) -> None:
    wide = identify(noisy.program, [noisy.fit.problem.logs[0].history], level=0.99)
    pairs = [(each, wide.estimate(each.name)) for each in noisy.estimates if each.deviation > 1e-9]
    assert pairs
    assert all(b.high - b.low >= a.high - a.low for a, b in pairs)
    assert np.all(np.linalg.eigvalsh(noisy.covariance) > -1e-12)


def test_the_patched_file_says_what_was_identified(noisy: Identification) -> None:
    text = noisy.loaded.source.text
    made = patched("# a comment\n" + text, file_values(noisy))
    assert made.startswith("# a comment\n")
    loaded = load_text(made, "patched.yaml")
    bench = loaded.task.shapes["bench"]
    stiffness = noisy.estimate("world.bench.stiffness")
    assert bench.stiffness == pytest.approx(stiffness.value, rel=1e-4)
    (variation,) = loaded.task.vary["world.bench.stiffness"]
    assert variation is not None
    assert variation.ends(0.0) == pytest.approx((stiffness.low, stiffness.high), rel=1e-4)
    assert loaded.true_task.robot.payload is not None


def test_set_lines_are_options(noisy: Identification) -> None:
    lines = list(set_lines(noisy))
    overrides = dict(line.removeprefix("--set '").removesuffix("'").split("=", 1) for line in lines)
    assert "world.bench.stiffness" in overrides
    loaded = load_text(noisy.loaded.source.text, "set.yaml", overrides)
    assert loaded.task.robot.sensor.delay == pytest.approx(0.003)


_LAID_OUT = """# head
robot: {model: panda, sensor: {noise: 0.1 N}}   # the arm
world:
  table: {shape: plane, normal: [0, 0, 1]}  # bench
  box:
    shape: box   # a box
    xyz:
      - 1 mm
      - 2 mm  # two
      - 3 mm
# end
"""


def test_comments_and_layout_stay() -> None:
    made = patched(
        _LAID_OUT,
        {
            "world.table.rpy": "[1 deg, 0, 0]",
            "world.table.stiffness": "3 kN/m",
            "world.box.xyz": "[9 mm, 0, 0]",
            "world.box.friction": "0.3",
            "robot.sensor.bias": "[1 N, 0, 0, 0, 0, 0]",
            "vary.world.table.stiffness": "1..2 kN/m",
            "vary.robot.joint_friction": "0..1 N*m",
        },
    )
    assert (
        made
        == """# head
robot: {model: panda, sensor: {noise: 0.1 N, bias: [1 N, 0, 0, 0, 0, 0]}}   # the arm
world:
  table: {shape: plane, rpy: [1 deg, 0, 0], stiffness: 3 kN/m}  # bench
  box:
    shape: box   # a box
    xyz: [9 mm, 0, 0]
    friction: 0.3
vary:
  world.table.stiffness: 1..2 kN/m
  robot.joint_friction: 0..1 N*m
# end
"""
    )


def test_a_value_without_keys_cannot_be_patched() -> None:
    with pytest.raises(PatchError, match="no place"):
        patched("world: {table: here}\n", {"world.table.friction": "0.2"})


def test_the_command(tmp_path: Path) -> None:
    """A run folder, a table, a patched file and JSON: as a user calls it."""
    from typer.testing import CliRunner

    from taskspec_runner.cli.app import app

    file = tmp_path / "press.yaml"
    file.write_text(press(NOISE), encoding="utf-8")
    runner = CliRunner()
    folder = tmp_path / "run"
    hidden = ["--set", "truth.world.bench.stiffness=24 kN/m"]
    made = runner.invoke(app, ["run", str(file), "--out", str(folder), "--quiet", *hidden])
    assert made.exit_code == 0, made.output
    out = tmp_path / "patched.yaml"
    what = ["--what", "world.bench.stiffness,world.bench.xyz"]
    shown = runner.invoke(app, ["identify", str(file), str(folder), *what, "--patch", str(out)])
    assert shown.exit_code == 0, shown.output
    assert "world.bench.stiffness" in shown.output
    assert "outside" in shown.output
    assert "kN/m" in out.read_text(encoding="utf-8")
    wrong = runner.invoke(
        app, ["identify", str(file), str(folder), "--what", "world.bench.stifness"]
    )
    assert wrong.exit_code == 2
    assert "did you mean 'world.bench.stiffness'" in wrong.output
    none = runner.invoke(app, ["identify", str(file), str(tmp_path / "nothing")])
    assert none.exit_code == 2


@pytest.mark.parametrize("seed", [0, 2, 3])
def test_a_payload_has_no_negative_mass(seed: int) -> None:
    """Of a short, noisy log without a payload the best mass would be negative, which no arm has."""
    sensor = "  sensor: {at: wrist, noise: {force: 0.2 N, torque: 10 mN*m}}\n"
    text = SWING.replace("  start:", f"{sensor}  start:")
    truth = {"robot.sensor.bias": "[1 N, -1 N, 2 N, 0.1 N*m, 0, 0]"}
    _, whole = run(text, truth, seed)
    columns = {name: values[:24] for name, values in whole.columns.items()}
    found = identify(program(text), [replace(whole, columns=columns, stages=whole.stages[:24])])
    payload = found.task.robot.payload
    assert payload is None or payload.mass >= 0
    mass = [e for e in found.estimates if e.path == "robot.payload.mass"]
    assert mass == [] or mass[0].low == 0.0
