"""What `explain` and `run` tell of a stage that keeps its limits by a program."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from taskspec_runner.cli.app import app
from taskspec_runner.cli.sheet.limits import joined

TASKS = Path(__file__).resolve().parents[2] / "tasks"


def run(*arguments: str) -> str:
    result = CliRunner().invoke(app, list(arguments), env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    return result.output


def test_joints_are_put_together():
    texts = ["torque of joint 1", "torque of joint 2", "force on table", "speed 1 mm/s"]
    together = ["torque of joints 1 to 2", "force on table", "speed 1 mm/s"]
    assert joined([*texts, "speed aside, 1"]) == together
    assert joined(["torque of joint 3"]) == ["torque of joint 3"]


@pytest.mark.parametrize(
    ("task", "told"),
    [
        ("wipe-friction", "5.71 N on x where 10 N is asked: friction of table"),
        ("press-saturated", "on z where -400 N is asked: static torque of joint 6"),
        ("tilted-force-qp", "3.42 N on x where 0 N is asked: nothing there returns a force"),
        ("press-qp", "all that it asks for, at the start pose"),
    ],
)
def test_explain_tells_what_contacts_return(task, told):
    text = run("explain", str(TASKS / f"{task}.yaml"))
    assert told in text
    assert "by a quadratic program (DAQP): torque of joints 1 to 7" in text


def test_explain_of_a_closed_form_says_nothing_of_a_program():
    assert "quadratic program" not in run("explain", str(TASKS / "press-hybrid.yaml"))


def test_run_tells_what_was_given_up(tmp_path):
    out = tmp_path / "run"
    text = run("run", str(TASKS / "wipe-friction.yaml"), "--out", str(out))
    assert "drag: 4.44 N of its set points cannot be returned" in text
    found = json.loads((out / "summary.json").read_text())["given_up"]
    assert found["drag"]["force_inconsistent"] == pytest.approx(4.441, abs=2e-3)
    assert found["wipe"]["force_inconsistent"] == 0
    assert all(entry["residual"] < 1e-8 for entry in found.values())
    # The shares of the limits that bound cover those ticks that were limited.
    for entry in found.values():
        assert sum(entry["limits"].values()) >= entry["limited"]
        assert all(share <= entry["limited"] for share in entry["limits"].values())


def test_run_under_a_limit_names_it(tmp_path):
    out = tmp_path / "run"
    text = run("run", str(TASKS / "reach-limits.yaml"), "--out", str(out))
    assert "out: limits changed" in text
    found = json.loads((out / "summary.json").read_text())["given_up"]["out"]
    assert next(iter(found["limits"])) == "position and velocity of joint 7"
    assert 0.5 < found["limited"] < 1
