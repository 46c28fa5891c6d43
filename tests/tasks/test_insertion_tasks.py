"""Insertion: what is uncertain may be, and what the strategy is for is needed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taskspec.spec import load_task
from taskspec_runner.session import execute

TASKS = Path(__file__).resolve().parents[2] / "tasks"


def run_world(task, number, folder, overrides=None):
    loaded = load_task(TASKS / f"{task}.yaml", overrides or {})
    return execute(loaded, folder, world=number, report=False)


@pytest.mark.parametrize(
    ("task", "socket"), [("peg-in-hole", "socket"), ("slot-insertion", "rail")]
)
@pytest.mark.parametrize("number", range(4))
def test_an_insertion_in_a_world(task, socket, number, tmp_path):
    """The bottom is felt where it is in truth: to 0.6 mm.

    A tip that leans by 2 deg is r sin(2 deg) = 0.35 mm above its lowest edge, and a bore of 25 mm
    that leans about both axes is 25 mm (1 - cos^2(2 deg)) = 0.03 mm less deep; a search that is
    2.8 mm aside on a leaning plate is 0.1 mm off.
    """
    run = run_world(task, number, tmp_path / "run")
    assert run.exit_code == 0
    told = {each["path"]: each["true"] for each in run.summary["world"]["differs"]}
    top = 1e3 * told[f"world.{socket}.xyz.z"]
    depth = 1e3 * load_task(TASKS / f"{task}.yaml").task.shapes[socket].depth
    end = 1e3 * np.asarray(run.column("position.z"))[-1]
    assert end == pytest.approx(top - depth, abs=0.6)


def test_a_peg_that_is_stuck_by_friction_gets_in_at_the_second_attempt(tmp_path):
    """As the page has it: stuck, lifted, and at the bottom from where it was."""
    rough = {"vary.world.socket.friction": "0.6..0.8"}
    run = run_world("peg-in-hole", 10, tmp_path / "run", rough)
    assert run.exit_code == 0
    attempt = ["approach", "search", "insert"]
    assert [visit.stage for visit in run.visits] == [*attempt, "lift", *attempt]
    first = run.during("insert", visit=1)
    assert np.asarray(first.signals["position.z"])[-1] > 0.29
    assert run.visits[-1].end < 20.0


def test_a_peg_that_may_not_turn_gets_stuck_is_lifted_and_tried_again(tmp_path):
    """A hole that leans under a peg that is held upright: it jams at two points, gently."""
    stiff = {"stages.insert.axes.rx": "hold", "stages.insert.axes.ry": "hold"}
    run = run_world("peg-in-hole", 0, tmp_path / "run", stiff)
    assert run.exit_code == 6
    visited = [visit.stage for visit in run.visits]
    assert visited.count("lift") == 3
    forces = np.array([run.column(f"force.{axis}") for axis in "xyz"])
    assert np.linalg.norm(forces, axis=0).max() < 20.0


@pytest.mark.parametrize("number", range(3))
def test_a_tight_peg_is_seated_in_time(number, tmp_path):
    """0.114 mm of clearance, 1 mm of noise, friction 0.75: at the true bottom, but for 8 N/k."""
    run = run_world("tight-peg", number, tmp_path / "run")
    assert run.exit_code == 0
    told = {each["path"]: each["true"] for each in run.summary["world"]["differs"]}
    end = 0.3 + np.asarray(run.column("position.z"))[-1]
    assert end == pytest.approx(told["world.socket.xyz.z"] - 0.025, abs=1e-4)
    assert run.visits[-1].end < 10.0


def test_a_tight_peg_that_misses_in_one_way_is_seated_in_the_other(tmp_path):
    """2.8 mm across the first way, of which the rim catches no more than some 2.3 mm."""
    aside = {"truth.world.socket.xyz": "[600 mm, 2.8 mm, 300 mm]"}
    loaded = load_task(TASKS / "tight-peg.yaml", aside)
    run = execute(loaded, tmp_path / "run", report=False)
    assert run.exit_code == 0
    visited = [visit.stage for visit in run.visits]
    assert visited.count("insert") == 2
    assert "reach_again" in visited
