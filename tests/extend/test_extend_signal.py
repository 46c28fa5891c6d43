"""A new signal, defined here and nowhere else, in everything that knows signals."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from taskspec.signals import SCALARS, Situation, signal
from taskspec.signals.operations import norm
from taskspec.text.units import ANGULAR_VELOCITY
from taskspec_runner.cli.app import app
from taskspec_runner.record.log import read_log

SPINNING = """\
taskspec: 1
name: spinning
robot: {model: panda, start: {xyz: [500 mm, 0, 400 mm]}}
stages:
  spin_up:
    axes: {rz: {velocity: 20 deg/s}, x: {velocity: "10 mm/s + spin * (1 mm/(1 rad))"}}
    until: spin > 19 deg/s for 50 ms
    within: {time: 1 s}
  hold: {time: 50 ms}
expect: [spin_up.spin < 25 deg/s]
"""


@pytest.fixture(autouse=True)
def spin() -> Iterator[None]:
    @signal("spin", ANGULAR_VELOCITY, low=0.0)
    def spin(at: Situation) -> Any:
        """Rate of turn of the tool."""
        return norm(at.world.twist[3:])

    yield
    del SCALARS["spin"]


@pytest.fixture
def task(tmp_path: Path) -> Path:
    path = tmp_path / "spinning.yaml"
    path.write_text(SPINNING, encoding="utf-8")
    return path


def call(*words: object) -> str:
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return done.output


def test_every_command(task: Path, tmp_path: Path) -> None:
    run, other = tmp_path / "run", tmp_path / "other"
    assert call("validate", task) == "no errors in 1 file\n"
    assert "spin_up.spin < 25 deg/s" in call("explain", task)
    assert "pass  spin_up.spin < 25 deg/s" in call("run", task, "--out", run)
    call("report", run)
    assert "<h3>Spin <small>deg/s</small></h3>" in (run / "report.html").read_text("utf-8")
    call("compare", task, "--law", "hybrid", "--law", "impedance", "--out", other)
    call("export", run, "--csv")
    call("schema")
    history = read_log(run / "log.arrow")
    assert history.units["spin"] == "rad/s"
    joints = [history.columns[f"joint.{i}.velocity"] for i in range(1, 8)]
    still = np.max(np.abs(joints), axis=0) == 0
    assert np.all(history.columns["spin"][still] == 0)
    assert np.max(history.columns["spin"]) == pytest.approx(np.deg2rad(20), rel=1e-2)


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (("19 deg/s", "19 mm/s"), "TS113"),
        (("spin > 19", "spim > 19"), "TS120"),
        (("spin > 19 deg/s for 50 ms", "spin < -1 deg/s"), "TS612"),
        (("spin_up.spin < 25", "spin_up.spin < -1"), "TS722"),
        (("  hold:", "  spin:"), "TS125"),
        (("spin_up.spin <", "spin_up.spin in world <"), "TS116"),
    ],
)
def test_findings(task: Path, change: tuple[str, str], code: str) -> None:
    task.write_text(SPINNING.replace(*change), encoding="utf-8")
    done = CliRunner().invoke(app, ["validate", str(task)])
    assert f"error[{code}]" in done.output
