"""A payload that laws adapt to, in runs: every loop, exported C, the sensor's zero, the summary."""

from __future__ import annotations

import shutil
import subprocess
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_task, load_text
from taskspec_runner import run
from taskspec_runner.cli.app import app
from taskspec_runner.loop import fixed_step
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.record.log import Log
from taskspec_runner.verdict.payload import sentences

TASKS = Path(__file__).resolve().parents[2] / "tasks"

#: Hangs, zeroes its sensor, turns and presses: a stage that adapts, some that do not, then one.
TEXT = """\
taskspec: 1
name: load
robot:
  model: ur5e
  tool: {shape: sphere, radius: 10 mm, length: 120 mm, mass: 300 g}
  sensor: SENSOR
law: {kind: LAW, adapt: {payload: {bandwidth: 2 Hz}}}
stages:
  hang: {time: 60 ms, tare: true}
  sway: {axes: {rx: {position: 20 deg * sin(2*pi*t/(0.4 s))}}, time: 60 ms}
  still: {law: LAW, time: 20 ms}
  again: {time: 20 ms}
truth:
  robot.payload: {mass: 300 g, xyz: [20 mm, -30 mm, 40 mm]}
"""
WRIST = "{at: wrist, bias: [1 N, 0, 0, 0, 0, 0], noise: 0.1 N, delay: 2 ms}"


def text(sensor="{at: contact}", law="hybrid"):
    return TEXT.replace("SENSOR", sensor).replace("LAW", law)


def logged(program, folder, loop):
    """The bytes that a loop writes, and which one it was."""
    folder.mkdir()
    path = folder / "log.arrow"
    parts = assemble(program)
    with closing(parts.recorder(Log(path))) as recorder:
        outcome = fixed_step.run(
            parts.machine,
            parts.plant,
            parts.bus,
            recorder,
            program.context.period,
            seed=3,
            loop=loop,
        )
    return path.read_bytes(), outcome.loop


@pytest.mark.parametrize("sensor", ["{at: contact}", WRIST])
def test_every_loop_writes_the_same(tmp_path, sensor):
    program = compile_unchecked(load_text(text(sensor), "load.yaml"))
    python, _ = logged(program, tmp_path / "python", "python")
    for loop in ("native", "interpreted"):
        found, tier = logged(program, tmp_path / loop, loop)
        assert tier in ("native", "interpreted")
        assert found == python
    assert b"payload.mass" in python


@pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
def test_exported_c_drives_the_arm_to_the_same_log(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("load.yaml").write_text(text(WRIST))
    command = CliRunner()
    done = command.invoke(app, ["export", "load.yaml", "--c", "c"])
    assert done.exit_code == 0, done.output
    built = ["gcc", "-std=c99", "-O1", "-shared", "-fPIC", "c/load.c", "-o", "c/load.so", "-lm"]
    assert subprocess.run(built, capture_output=True).returncode == 0
    for out, given in (("own", []), ("by-c", ["--on", "lib:c/load.so"])):
        done = command.invoke(app, ["run", "load.yaml", *given, "--out", out, "--quiet"])
        assert done.exit_code == 0, done.output
    own, driven = ((tmp_path / out / "log.arrow").read_bytes() for out in ("own", "by-c"))
    assert own == driven


def test_a_stage_without_the_key_keeps_the_estimate_and_the_next_goes_on(simulate):
    made = simulate(text())
    mass = made["payload.mass"]
    still, again = (made.history.window(name) for name in ("still", "again"))
    (value,) = np.unique(mass[still][1:])
    assert value > 0.05
    # The filter begins anew: two ticks later the estimate moves again.
    assert mass[again][1] == value
    assert mass[again][-1] > value


ZERO = """\
taskspec: 1
name: zero
robot:
  model: panda
  tool: {shape: sphere, radius: 10 mm, length: 120 mm, mass: 300 g}
  sensor: {at: wrist, bias: [1 N, 0, 0, 0, 0, 0]}
law: {kind: pd, adapt: {payload: {bandwidth: 2 Hz}}}
stages:
  settle: {law: pd, time: 600 ms}
  zero: {law: pd, time: 200 ms, tare: true}
  learn: {time: 600 ms}
  lean: {axes: {ry: {move: 20 deg, speed: 40 deg/s}}}
  still: {time: 500 ms}
truth: {robot.payload: 300 g}
"""


def test_a_zero_that_was_taken_before_the_payload_was_known_is_put_right(simulate):
    """Leant by 20 deg the wrist reads nothing; under the plain law m g 2 sin(10 deg)."""
    read = {}
    for law in ("{kind: pd, adapt: {payload: {bandwidth: 2 Hz}}}", "pd"):
        made = simulate(ZERO.replace("{kind: pd, adapt: {payload: {bandwidth: 2 Hz}}}", law))
        ticks = np.flatnonzero(made.history.window("still"))[400:]
        assert len(ticks) == 100
        forces = [made[f"force.{axis}.measured"][ticks].mean() for axis in "xyz"]
        read[law] = float(np.linalg.norm(forces))
    known, plain = read.values()
    assert plain == pytest.approx(0.3 * 9.81 * 2 * np.sin(np.deg2rad(10)), rel=0.05)
    # The dead zone leaves 10 g of the mass, and what it leaves of the centre is no force.
    assert known < 0.1 * 2 * np.sin(np.deg2rad(10)) + 0.02


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    return run(
        load_task(TASKS / "unknown-payload.yaml"),
        out=tmp_path_factory.mktemp("payload") / "known",
    )


def test_the_shipped_task_meets_what_the_plain_law_misses(known, tmp_path):
    assert all(each["passed"] for each in known.summary["expectations"])
    assert len(known.summary["expectations"]) == 3
    plain = (TASKS / "unknown-payload.yaml").read_text()
    assert ", adapt: payload" in plain
    plain = plain.replace(", adapt: payload", "")
    lines = [line for line in plain.splitlines() if "knows-mass" not in line]
    made = run(load_text("\n".join(lines), "plain.yaml"), out=tmp_path / "plain", report=False)
    missed = [each["passed"] for each in made.summary["expectations"]]
    assert missed == [False, False]
    assert "payload" not in made.summary
    assert "payload.mass" not in made.columns


def test_summary_line_and_report_say_what_was_learned(known):
    data = known.summary["payload"]
    assert data["mass"] == pytest.approx(0.3, abs=0.02)
    assert 0.1 < data["least_eigenvalue"] < 1
    assert all(share > 0.9 for share in data["shown"].values())
    (line,) = sentences(known.summary)
    assert line.startswith("payload: 0.29")
    # The dead zone leaves centimetres of a centre that gravity hardly turns against.
    assert 5e-3 < data["within"]["x"] < data["within"]["z"] < 50e-3
    assert abs(data["mass"] - 0.3) < data["within"]["mass"]
    assert line.count(" +- ") == 4
    assert "show" not in line
    page = (known.folder / "report.html").read_text(encoding="utf-8")
    assert "Mass of the payload" in page
    assert "Centre of the payload" in page


def test_a_tool_that_only_hangs_does_not_show_the_centre_along_gravity(tmp_path):
    hung = text().partition("  sway:")[0] + "truth:\n  robot.payload: 300 g\n"
    hung = hung.replace(", tare: true", "").replace("60 ms", "400 ms")
    made = run(load_text(hung, "hung.yaml"), out=tmp_path / "hung", report=False)
    data = made.summary["payload"]
    # Not quite zero: as the payload pulls at it, the arm swings.
    assert data["least_eigenvalue"] < 0.05
    (line,) = sentences(made.summary)
    assert "this run does not show its centre along " in line
    assert "?" in line
