"""Bodies in the gripper: what is found with a trial."""

from __future__ import annotations

from trials import found, serious
from typer.testing import CliRunner

from taskspec.spec import load_text
from taskspec_runner import run
from taskspec_runner.cli import app

TASK = """\
taskspec: 1
robot:
  model: panda
  tool: {shape: sphere, radius: 4 mm, length: 120 mm, mass: 700 g}
  gripper: {axis: y}
  start: {xyz: [450 mm, 0, 330 mm]}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], friction: 0.4}
  block:
    {shape: box, size: [60 mm, 40 mm, 60 mm], free: true, mass: 500 g, xyz: [450 mm, 0, 330 mm],
     friction: 0.4}
stages:
  grasp: {grip: {object: block, force: FORCE}, time: 1 s}
  lift: {axes: {z: {move: 100 mm, speed: SPEED}}}
"""
HELD = TASK.replace("FORCE", "15 N").replace("SPEED", "100 mm/s")
#: 2 mu N = 5.6 N bear the 4.9 N of the body, and not what a fast lift adds.
LOST = TASK.replace("FORCE", "7 N").replace("SPEED", "1 m/s")


def test_a_force_that_is_the_weight_of_what_is_gripped(tmp_path, monkeypatch):
    """An expectation that it breaks is explained as one of an arm that touches nothing else."""
    text = HELD + "  hold: {time: 1 s}\nexpect: [max(abs(hold.force.z)) < 0.5 N]\n"
    assert serious(text) == ["TS726"]
    assert "= 4.9" in found(text, "TS726").message
    monkeypatch.chdir(tmp_path)
    (tmp_path / "held.yaml").write_text(text, encoding="utf-8")
    done = CliRunner().invoke(app, ["explain", "held.yaml"])
    assert done.exit_code == 0, done.output


def test_what_is_lost_in_the_trial_is_no_remark(tmp_path):
    """TS353 stays a warning, and the run says where the body slips out."""
    assert serious(HELD) == []
    assert sorted(serious(LOST)) == ["TS353", "TS521"]
    assert "ends well" not in found(LOST, "TS353").message
    made = run(load_text(LOST, "task.yaml"), tmp_path / "lost", report=False)
    (slip,) = made.summary["slips"]
    assert (slip["stage"], slip["lost"]) == ("lift", True)
