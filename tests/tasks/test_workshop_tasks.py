"""The closed form of deburring, what each strategy is for, and what breaks each expectation."""

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


_ROUND_THE_PIPE = {
    "truth.world.pipe.xyz": "[503 mm, 0, 110 mm]",
    "truth.world.pipe.stiffness": "40 kN/m",
}


@pytest.mark.parametrize(
    ("task", "overrides", "broken"),
    [
        # Beside the groove the tool slides over the plate.
        ("groove-following", {"truth.world.guide.xyz": "[450 mm, 9 mm, 300 mm]"}, {"in-groove"}),
        # A groove that sinks away, followed three times as fast: the force loop is behind.
        (
            "groove-following",
            {
                "truth.world.guide.rpy": "[0, 3 deg, 0]",
                "stages.follow.axes.x.speed": "120 mm/s",
            },
            {"pressed"},
        ),
        ("groove-following", {"stages.approach.axes.z.velocity": "-60 mm/s"}, {"gentle"}),
        # A feed that does not wait, on another pipe than the file says.
        ("raster-polish", {"stages.polish.path.speed": "pace"} | _ROUND_THE_PIPE, {"polished"}),
        ("raster-polish", {"stages.spot.path.speed": "pace"} | _ROUND_THE_PIPE, {"spot"}),
        # The place is held, and the force is let go.
        ("raster-polish", {"stages.rest.axes.z": "hold"}, {"rested"}),
        ("raster-polish", {"law.bandwidth": "1 Hz"}, {"along"}),
        (
            "raster-polish",
            {"law.bandwidth": "1 Hz", "truth.world.pipe.friction": "0.3"},
            {"along", "across"},
        ),
        ("raster-polish", {"params.pace": "50 mm/s"}, {"soon"}),
        ("corner-seating", {"stages.seat.axes.ry": "hold"}, {"flat"}),
        ("corner-seating", {"robot.start.rpy": "[178.5 deg, 1 deg, 3.5 deg]"}, {"square"}),
        ("corner-seating", {"stages.seat.axes.x.force": "8 N"}, {"touching"}),
        ("corner-seating", {"stages.down.axes.z.velocity": "-80 mm/s"}, {"gentle"}),
        ("edge-following", {"truth.world.plate.size": "[190 mm, 80 mm, 20 mm]"}, {"end"}),
        # The controller presses with what the sensor shows.
        ("edge-following", {"truth.robot.sensor.bias": "[0, 2.5 N, 0, 0, 0, 0]"}, {"pressed"}),
        ("edge-following", {"stages.approach.axes.y.velocity": "-150 mm/s"}, {"gentle"}),
        ("pivot-box", {"law.bandwidth": "1 Hz"}, {"edge-stays"}),
        ("pivot-box", {"stages.down.axes.z.velocity": "-150 mm/s"}, {"gentle"}),
        ("stiffness-identification", {"truth.world.sample.stiffness": "15 kN/m"}, {"stiffness"}),
        ("stiffness-identification", {"stages.approach.axes.z.velocity": "-120 mm/s"}, {"gentle"}),
    ],
)
def test_each_expectation_is_broken_by_what_it_is_about(task, overrides, broken, tmp_path):
    """A faster feed, a wrong gain, another world: that expectation is missed, and no other."""
    run = run_task(task, tmp_path / "run", overrides)
    assert run.summary["status"] == "done"
    missed = {each["name"] for each in run.summary["expectations"] if not each["passed"]}
    assert missed == broken
