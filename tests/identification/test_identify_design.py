"""Designed tasks: safe, accepted, and in hidden worlds as telling as they were predicted to be."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taskspec.compiler import compile_unchecked
from taskspec.program.worlds import true_world
from taskspec.spec import load_text
from taskspec.text.diagnostic import Severity
from taskspec_runner.cli import app
from taskspec_runner.errors import InputError
from taskspec_runner.identify import identify
from taskspec_runner.identify.design import DesignedTask, design
from taskspec_runner.trial.check import check
from taskspec_runner.trial.trial import trial
from taskspec_runner.verdict.metrics import peaks

LEVEL = 0.9
#: By how much an interval may differ from the predicted one in a world with a stiffness of half or
#: twice that of the file: displacements, which tell the stiffness, go with its inverse, and the
#: damping with what the contact moves at.
FACTOR = 3.0

PRESS = """\
taskspec: 1
name: bench
robot:
  model: ur5e
  tool: {shape: sphere, radius: 12 mm, length: 120 mm, mass: 400 g}
  start: {xyz: [450 mm, 100 mm, 315 mm]}
  sensor: {at: wrist, noise: {force: 0.15 N, torque: 8 mN*m}}   # of its data sheet
world:
  bench: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 15 kN/m, damping: 40 N*s/m, friction: 0.2}
frames: {task: {surface: bench}}
frame: task
limits: {force: 40 N}
stages:
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -3 N for 10 ms, within: 4 s}
  press: {axes: {z: {force: -6 N}}, time: 0.5 s}
"""
WHAT = [
    "world.bench.stiffness",
    "world.bench.damping",
    "world.bench.friction",
    "robot.payload.mass",
]


@pytest.fixture(scope="module")
def designed() -> DesignedTask:
    return design(load_text(PRESS, "bench.yaml"), WHAT, 0.1, LEVEL)


def test_it_is_accepted_safe_and_tells_what_is_wanted(designed: DesignedTask) -> None:
    assert designed.met
    assert {each.estimate.name for each in designed.predicted} == set(WHAT)
    assert designed.peak < 0.9 * designed.limit == 0.9 * 40
    assert "# of its data sheet" in designed.text
    found = check(load_text(designed.text, "bench-identify.yaml"))
    assert not [each for each in found.findings if each.severity is Severity.ERROR]


@pytest.mark.parametrize(
    "truth",
    [
        {"stiffness": "9 kN/m", "damping": "70 N*s/m", "friction": "0.35", "mass": "180 g"},
        {"stiffness": "26 kN/m", "damping": "55 N*s/m", "friction": "0.12", "mass": "60 g"},
    ],
)
def test_intervals_hold_a_hidden_world_and_are_as_narrow_as_predicted(
    designed: DesignedTask, truth: dict[str, str]
) -> None:
    hidden = "".join(
        f"  world.bench.{key}: {value}\n" for key, value in truth.items() if key != "mass"
    )
    hidden += f"  robot.payload: {{mass: {truth['mass']}}}\n"
    run = trial(compile_unchecked(load_text(f"{designed.text}truth:\n{hidden}", "hidden.yaml")))
    assert run.good
    largest = peaks(run.history, [stage.name for stage in run.program.stages])
    assert max(each["force"] for each in largest.values()) < designed.limit
    program = compile_unchecked(load_text(designed.text, "bench-identify.yaml"))
    found = identify(program, [run.history], WHAT, 0.99)
    task = true_world(run.program.context).task
    bench = task.shapes["bench"]
    assert task.robot.payload is not None
    true = dict(
        zip(
            WHAT,
            (bench.stiffness, bench.damping, bench.friction, task.robot.payload.mass),
            strict=True,
        )
    )
    half = {each.estimate.name: each.half for each in designed.predicted}
    narrow = {each.name: each for each in identify(program, [run.history], WHAT, LEVEL).estimates}
    for name, value in true.items():
        assert found.estimate(name).low <= float(value) <= found.estimate(name).high, name
        ratio = (narrow[name].high - narrow[name].low) / 2 / half[name]
        assert 1 / FACTOR < ratio < FACTOR, (name, ratio)


def test_it_is_longer_where_less_is_wanted() -> None:
    """Half of an interval goes with one over the root of the time."""
    loaded = load_text(PRESS, "bench.yaml")
    rough = design(loaded, ["world.bench.damping"], 0.1, LEVEL)
    [own] = rough.predicted
    fine = design(loaded, ["world.bench.damping"], 0.7 * own.half / own.estimate.value, LEVEL)
    assert fine.duration > rough.duration
    assert fine.predicted[0].half < own.half


def test_a_lower_limit_makes_it_gentler() -> None:
    text = PRESS.replace("limits: {force: 40 N}", "limits: {force: 20 N}")
    found = design(load_text(text, "bench.yaml"), ["world.bench.stiffness"], 0.1, LEVEL)
    assert found.peak < 0.9 * 20


def test_a_file_that_presses_nowhere_is_an_error() -> None:
    text = PRESS[: PRESS.index("  press: {axes")]
    with pytest.raises(InputError, match="no stage of this task presses"):
        design(load_text(text, "bench.yaml"), WHAT, 0.1, LEVEL)


def test_the_command_writes_a_file_and_says_what_is_assumed(tmp_path: Path) -> None:
    silent = PRESS.replace(", noise: {force: 0.15 N, torque: 8 mN*m}", "")
    file, out = tmp_path / "bench.yaml", tmp_path / "out.yaml"
    file.write_text(silent, encoding="utf-8")
    asked = ["identify", str(file), "--design", str(out), "--format", "json"]
    result = CliRunner().invoke(app, [*asked, "--what", "world.bench.stiffness"])
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert data["met"]
    assert data["unidentified"] == []
    assert any("has no noise" in each for each in data["remarks"])
    assert load_text(out.read_text(encoding="utf-8"), "out.yaml").task.name == "bench-identify"


def test_without_a_design_a_log_is_needed(tmp_path: Path) -> None:
    file = tmp_path / "bench.yaml"
    file.write_text(PRESS, encoding="utf-8")
    result = CliRunner().invoke(app, ["identify", str(file)])
    assert result.exit_code == 2
