"""Samples that are lost, come again or out of order: what each policy makes of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from meeting import TOUCH, ClockedRobot, drive, own_columns, program_of, same_bits

from taskspec_runner import read
from taskspec_runner.errors import InputError
from taskspec_runner.link.on_robot import CATCH_UP, HOLD, LostPolicy
from taskspec_runner.runs import Run
from taskspec_runner.session import execute_program

#: Three in a row in the approach, one in the hold.
LOST = (50, 51, 52, 200)


@pytest.fixture
def plain(tmp_path: Path) -> Run:
    return execute_program(program_of(TOUCH), tmp_path / "plain", report=False)


def test_clock_that_goes_on_is_lock_step_if_all_come(plain: Run, tmp_path: Path) -> None:
    run = drive(TOUCH, ClockedRobot(program_of(TOUCH)), tmp_path / "run")
    same_bits(run, plain, own_columns(run))
    assert run.summary["link"]["lost"] == 0
    assert not run.signals["link.lost"].any()


def test_catching_up_keeps_to_the_robots_clock(plain: Run, tmp_path: Path) -> None:
    robot = ClockedRobot(program_of(TOUCH), lost=LOST)
    run = drive(TOUCH, robot, tmp_path / "run", LostPolicy(CATCH_UP))
    lost = np.flatnonzero(run.signals["link.lost"])
    assert lost.tolist() == list(LOST)
    # The robot's clock and the task's are the same; the last sample is the one that ends the run.
    assert len(run) == robot.plant_ticks - 1
    # A tick without a sample is one on the sample before.
    for tick in LOST:
        q = run.signals["joint.1.position"]
        assert q[tick] == q[tick - 1]
    # References go on meanwhile, as if nothing had been lost.
    reference, wanted = (r.during("approach").signals["position.y.ref"] for r in (run, plain))
    n = min(len(reference), len(wanted))
    assert np.abs(reference[:n] - wanted[:n]).max() < 1e-12
    time = run.during("approach").signals["t"]
    assert np.allclose(np.diff(time), 1e-3)
    link = run.summary["link"]
    assert (link["lost"], link["in_a_row"]) == (4, 3)
    assert run.verdict == "passed"
    assert "as measured" in run.reason


@pytest.mark.parametrize(("most", "passes"), [(2, False), (3, True)])
def test_a_file_judges_what_was_lost(most: int, passes: bool, tmp_path: Path) -> None:
    """Three in a row are lost, and 4 of all samples: what was injected is what is judged."""
    text = (
        TOUCH + f"  - max(link.lost) <= {most}\n  - max(hold.link.lost) < 2\n  - link.late < 1 s\n"
    )
    robot = ClockedRobot(program_of(text), lost=LOST)
    run = drive(text, robot, tmp_path / "run", LostPolicy(HOLD))
    judged = {each.text: each.passed for each in run.expectations}
    assert judged[f"max(link.lost) <= {most}"] is passes
    assert judged["max(hold.link.lost) < 2"]
    assert judged["link.late < 1 s"]
    assert run.verdict == ("passed" if passes else "missed")
    # What was recorded says the same when it is judged again.
    assert [each.passed for each in read(tmp_path / "run").expectations] == [*judged.values()]


def test_nothing_is_late_or_lost_in_one_loop(tmp_path: Path) -> None:
    text = TOUCH + "  - max(link.lost) < 1\n  - max(link.late) <= 0 s\n  - max(link.lost) > 0\n"
    run = execute_program(program_of(text), tmp_path / "plain", report=False)
    assert [each.passed for each in run.expectations] == [True] * 4 + [False]
    assert not any(name.startswith("link.") for name in run.history.columns)


def test_holding_makes_the_task_stand_still(tmp_path: Path) -> None:
    robot = ClockedRobot(program_of(TOUCH), lost=LOST)
    run = drive(TOUCH, robot, tmp_path / "run", LostPolicy(HOLD))
    # Its time is that of the samples that came.
    assert len(run) == robot.plant_ticks - 1 - len(LOST)
    lost = run.signals["link.lost"]
    assert {int(i): int(lost[i]) for i in np.flatnonzero(lost)} == {50: 3, 197: 1}
    assert np.allclose(np.diff(run.clock), 1e-3)
    assert run.summary["link"]["lost"] == 4


@pytest.mark.parametrize(("most", "status"), [(2, "stopped"), (3, "done")])
@pytest.mark.parametrize("lost", [CATCH_UP, HOLD])
def test_too_many_in_a_row_stop_the_run(lost: str, most: int, status: str, tmp_path: Path) -> None:
    robot = ClockedRobot(program_of(TOUCH), lost=LOST)
    run = drive(TOUCH, robot, tmp_path / "run", LostPolicy(lost, most))
    assert run.summary["status"] == status
    if status == "stopped":
        assert run.exit_code == 4
        assert run.summary["ending"]["reason"] == "samples_lost"
        assert "3 samples in a row were lost, 3 ms" in run.reason
        assert len(run) == 50 == run.summary["ticks"]
        assert "3 samples in a row" in robot.stopped


def test_samples_that_come_twice_are_taken_once(plain: Run, tmp_path: Path) -> None:
    robot = ClockedRobot(program_of(TOUCH), twice=range(20, 60))
    run = drive(TOUCH, robot, tmp_path / "run")
    same_bits(run, plain, own_columns(run))
    assert run.summary["link"]["repeated"] == 40


def test_samples_that_were_overtaken_are_left_out(tmp_path: Path) -> None:
    robot = ClockedRobot(program_of(TOUCH), swapped=[40, 90])
    run = drive(TOUCH, robot, tmp_path / "run")
    link = run.summary["link"]
    # Each was missed when the later one came, and is old when it comes.
    assert (link["reordered"], link["lost"], link["in_a_row"]) == (2, 2, 1)
    assert np.flatnonzero(run.signals["link.lost"]).tolist() == [40, 90]
    assert run.summary["status"] == "done"


@pytest.mark.parametrize("scale", [0.98, 1.02])
def test_clock_that_drifts_loses_or_skips_one_in_a_while(scale: float, tmp_path: Path) -> None:
    robot = ClockedRobot(program_of(TOUCH), scale=scale)
    run = drive(TOUCH, robot, tmp_path / "run")
    link = run.summary["link"]
    assert run.summary["status"] == "done"
    # After n ticks, the robot's clock is n |scale - 1| ticks off, within one.
    off = robot.plant_ticks * abs(scale - 1)
    made_up = link["lost"] if scale > 1 else link["early"]
    assert abs(made_up - off) <= 1.5
    assert link["in_a_row"] <= 1


def test_robot_that_is_gone_stops_the_run(tmp_path: Path) -> None:
    robot = ClockedRobot(program_of(TOUCH), ends_at=120)
    run = drive(TOUCH, robot, tmp_path / "run")
    assert (run.summary["status"], run.exit_code) == ("stopped", 4)
    assert run.summary["ending"]["reason"] == "connection_lost"
    assert len(run) == 120 == run.summary["ticks"]


def test_policies_that_there_are_not() -> None:
    with pytest.raises(InputError, match="catch-up or hold, not 'wait'"):
        LostPolicy("wait")
    with pytest.raises(InputError, match="0 or more samples, not -1"):
        LostPolicy(HOLD, -1)
