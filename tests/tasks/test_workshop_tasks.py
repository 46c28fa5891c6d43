"""Deburring, seating in a corner, pivoting: the closed form, and what each strategy is for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from taskspec.spec import load_task
from taskspec_runner.session import execute

TASKS = Path(__file__).resolve().parents[2] / "tasks"


def run_task(task, folder, overrides=None):
    return execute(load_task(TASKS / f"{task}.yaml", overrides or {}), folder, report=False)


@pytest.mark.parametrize("damping", [200, 400, 1200])
def test_the_feed_settles_where_the_force_and_the_speed_agree(damping, tmp_path):
    """F = d s + R and s = v (1 - F/F0) give F = (d v + R)/(1 + d v/F0).

    What rubs, R, is the chip's 1 N and 0.2 of the 8 N on the edge.
    """
    run = run_task("deburr", tmp_path / "run", {"world.chip.damping": f"{damping} N*s/m"})
    assert run.exit_code == 0
    cut = damping * 0.06
    expected = (cut + 1.0 + 0.2 * 8.0) / (1 + cut / 16.0)
    force = np.asarray(run.during("deburr").signals["force.x"])
    # Between meeting the burr and slowing down for the end of the line.
    force = force[len(force) // 2 : len(force) * 3 // 4]
    assert len(force) > 250
    assert force == pytest.approx(expected, rel=5e-3)


def test_a_block_that_may_not_turn_stays_askew(tmp_path):
    """It is held by 2.5 deg about z, and the same forces alone do not turn it."""
    stiff = {f"stages.seat.axes.{axis}": "hold" for axis in ("rx", "ry", "rz")}
    run = run_task("corner-seating", tmp_path / "run", stiff)
    assert run.exit_code == 1
    met = {each["name"]: each["passed"] for each in run.summary["expectations"]}
    assert met == {"flat": False, "square": False, "touching": True, "gentle": True}
    assert abs(np.asarray(run.column("position.rz"))[-1]) < np.deg2rad(0.3)


def test_a_moment_of_zero_about_the_edge_leaves_the_box_on_it(tmp_path):
    run = run_task("pivot-box", tmp_path / "run", {"stages.press.frame": "edge"})
    assert run.exit_code == 1
    met = {each["name"]: each["passed"] for each in run.summary["expectations"]}
    assert met == {"flat": False, "edge-stays": True, "gentle": True}
