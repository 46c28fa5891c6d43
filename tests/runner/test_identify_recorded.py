"""Presses that others have recorded are identified, and predicted where they were held out."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from taskspec.spec import load_task
from taskspec_runner import run
from taskspec_runner.cli import app
from taskspec_runner.identify import identify
from taskspec_runner.identify.identification import Identification

CELL = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "cell"
PRESSES = sorted(CELL.glob("press-*.csv"))
WHAT = ["world.cell.stiffness", "world.cell.xyz"]


@pytest.fixture(scope="module")
def found() -> Identification:
    """What three of the presses say, and what they predict of the others."""
    task = load_task(CELL / "press.yaml")
    return identify(
        task, PRESSES[:3], WHAT, columns=CELL / "columns.yaml", held_out=PRESSES[3:]
    )  # fmt: skip


def test_stiffness_is_that_of_least_squares(found):
    """Second implementation: f = k max(0, o - x), by least squares over k and o."""
    rows = np.concatenate([np.loadtxt(p, delimiter=",", skiprows=1)[:91] for p in PRESSES[:3]])
    x, f = rows[:, 1], 0.1 * rows[:, 2]  # 1 um is 1 mm here, 1 nN is 0.1 N

    def left(o: float) -> tuple[float, float]:
        depth = np.maximum(o - x, 0.0)
        k = float(depth @ f / (depth @ depth))
        return float(np.square(f - k * depth).sum()), k

    _, k = min(left(o) for o in np.linspace(x.min() + 1, x.max(), 400))
    identified = found.estimate("world.cell.stiffness")
    # The cell stiffens, and what a stiffness leaves is far from white. Where the readings of a tick
    # count by what is new in them, as here, the steep end weighs more: measured 11 % stiffer.
    assert 1e3 * k < identified.value < 1.2e3 * k


def test_held_out_presses_are_predicted(found):
    """A cell stiffens, which a stiffness does not: 5 % of the peak is left, 15 % at the peak."""
    shares = {each.log: each.share for each in found.held_out}
    assert len(shares) == 12
    assert all(each.channel == "force.z" and each.unit == "N" for each in found.held_out)
    assert np.median(list(shares.values())) < 0.06
    # The fifth began 0.3 um lower than the others, and peaks at 26 N instead of 31 N.
    assert {Path(log).name for log, share in shares.items() if share > 0.1} <= {"press-05.csv"}
    assert max(shares.values()) < 0.12


def test_the_command_shows_what_is_predicted():
    arguments = ["identify", str(CELL / "press.yaml"), str(PRESSES[0]), "--what", "world.cell"]
    arguments += ["--columns", str(CELL / "columns.yaml"), "--held-out", str(PRESSES[8])]
    shown = CliRunner().invoke(app, arguments)
    assert shown.exit_code == 0
    assert "press-09.csv: force.z is predicted to 1.5" in shown.output
    data = json.loads(CliRunner().invoke(app, [*arguments, "--format", "json"]).output)
    (held,) = data["held_out"]
    assert held["rms"] / abs(held["peak"]) == pytest.approx(held["share"])


TARED = """taskspec: 1
name: tared
robot:
  model: ur5e
  tool: {shape: sphere, radius: 12 mm, length: 120 mm, mass: 400 g}
  start: {xyz: [450 mm, 100 mm, 330 mm], rpy: [180 deg, 0, 0]}
  sensor: {noise: 0.05 N, bias: [0, 0, 1 N, 0, 0, 0]}
params: {press: 10 N}
world: {bench: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m, damping: 40 N*s/m}}
frames: {task: {surface: bench}}
frame: task
truth: {world.bench.stiffness: 14 kN/m}
stages:
  rest: {tare: true, time: 0.3 s}
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -2 N for 10 ms, within: 4 s}
  press: {axes: {z: {force: "-press - 4 N*sin(2*pi*t/(0.4 s))"}}, time: 1 s}
"""


def test_a_log_that_tares_is_predicted_to_its_noise(tmp_path):
    """Of its own zero, which no other log tells, the one that leaves least is taken."""
    logs, file = [], tmp_path / "tared.yaml"
    file.write_text(TARED)
    for press in ("10 N", "18 N"):
        task = load_task(file, {"params.press": press})
        logs.append(run(task, tmp_path / press, report=False).history)
    found = identify(load_task(file), logs[:1], ["world.bench"], held_out=logs[1:])
    assert found.estimate("world.bench.stiffness").value == pytest.approx(14e3, rel=0.02)
    force = next(each for each in found.held_out if each.channel == "force.z")
    assert abs(force.peak) > 18
    assert force.rms == pytest.approx(0.05, rel=0.2)
