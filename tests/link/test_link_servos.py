"""Arms that take velocities or positions: named before anything moves, at rest in the end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from meeting import POSITIONS, TOUCH, VELOCITIES, Serving, drive_at, log_bytes, program_of

from taskspec_runner.errors import InputError, LinkError
from taskspec_runner.link.robot import RobotFacts
from taskspec_runner.link.server import STOP_AFTER, ServerOptions, welcome
from taskspec_runner.link.udp_robot import UdpRobot, _facts
from taskspec_runner.session import execute_program

#: Of the servo of both tasks, in a control period [rad/s].
STEP = 20.0 * 1e-3


def test_a_welcome_names_what_is_commanded_and_the_servo() -> None:
    said = welcome(program_of(VELOCITIES), ServerOptions())["robot"]
    assert said["command"] == "velocity"
    assert said["servo"]["bandwidth"] == 50
    assert said["servo"]["acceleration"] == [20, 20]
    assert welcome(program_of(POSITIONS), ServerOptions())["robot"]["command"] == "position"


def test_a_welcome_that_names_no_command_is_of_torques() -> None:
    said = welcome(program_of(TOUCH), ServerOptions())
    assert said["robot"].pop("command") == "torque"
    assert "servo" not in said["robot"]
    facts, _ = _facts(said, "there")
    assert facts == RobotFacts.of(program_of(TOUCH), lock_step=True)
    said["robot"]["command"] = "current"
    with pytest.raises(InputError, match="is not what version 1 of the protocol requires"):
        _facts(said, "there")


@pytest.mark.parametrize(
    ("plant", "task", "takes", "commands"),
    [
        (VELOCITIES, TOUCH, "velocities", "torques"),
        (TOUCH, POSITIONS, "torques", "positions"),
        (POSITIONS, VELOCITIES, "positions", "velocities"),
    ],
)
def test_a_robot_that_takes_another_quantity_is_refused_by_name(
    plant: str, task: str, takes: str, commands: str
) -> None:
    ours, theirs = (RobotFacts.of(program_of(each), lock_step=True) for each in (task, plant))
    text = f"the robot at there takes joint {takes}, the task commands joint {commands}; say"
    with pytest.raises(InputError, match=text):
        ours.check(theirs, "there")


def test_commands_of_another_quantity_are_refused_and_the_right_ones_drive(tmp_path: Path) -> None:
    plain = execute_program(program_of(VELOCITIES), tmp_path / "plain", report=False)
    with Serving(VELOCITIES, tmp_path / "served") as serving:
        wrong = UdpRobot(serving.url, patience=20.0)
        facts = wrong.facts
        wrong.facts = RobotFacts(*(getattr(facts, name) for name in ("name", "joints", "period")))
        wrong.read()
        with pytest.raises(LinkError, match="takes joint velocities, and the command has joint to"):
            wrong.read()
        wrong.stop("")
        drive_at(VELOCITIES, serving.url, tmp_path / "driven")
        run = serving.run
    assert log_bytes(run) == log_bytes(plain)


def commanded(run, command: str) -> np.ndarray:
    """(ticks, 2) of a run until it rests."""
    names = [f"joint.{joint}.{command}.command" for joint in (1, 2)]
    parts = (run.signals, run.to_rest.signals)
    return np.concatenate([np.column_stack([each[name] for name in names]) for each in parts])


@pytest.mark.parametrize("command", ["velocity", "position"])
def test_an_arm_comes_to_rest_when_its_controller_is_gone(command: str, tmp_path: Path) -> None:
    task, options = VELOCITIES, ServerOptions(wait=20.0, answer=0.2)
    if command == "position":
        task = POSITIONS
    with Serving(task, tmp_path / "served", options) as serving:
        robot = UdpRobot(serving.url, patience=20.0)
        rate, begin = np.array([0.3, -0.2]), np.zeros(2)
        for tick in range(61):
            sample = robot.read()
            if tick == 0:
                begin = sample.q.copy()
            robot.write(rate if command == "velocity" else begin + rate * tick * 1e-3)
        run = serving.run
        robot.stop("it has been silent")
    assert run.summary["ending"]["reason"] == "connection_lost"
    assert abs(run.signals["joint.1.velocity"][-1]) > 0.1
    assert run.summary["stopping"]["residual_joint_speed"] < 0.01
    found = commanded(run, command)
    slowing = found[60:] if command == "velocity" else np.diff(found[61:], axis=0) / 1e-3
    assert len(slowing) > 400
    assert np.abs(np.diff(slowing, axis=0)).max() < STEP * 1.001
    assert np.abs(slowing[-1]).max() < 1e-9
    # It goes on and stops: what it comes back by is the servo's own overshoot.
    place = np.asarray(run.to_rest.signals["joint.1.position"])
    assert place.max() - place[-1] < 0.2 * (place[-1] - place[0])


def test_a_velocity_is_held_by_nobody_for_ever(tmp_path: Path) -> None:
    """At the wall clock, with more lost answers borne than a velocity is held for."""
    options = ServerOptions(free_running=True, stop_after=60, wait=20.0)
    with Serving(VELOCITIES, tmp_path / "served", options) as serving:
        robot = UdpRobot(serving.url, patience=20.0)
        for _ in range(30):
            robot.read()
            robot.write(np.array([0.3, -0.2]))
        run = serving.run
        robot.stop("")
    assert run.summary["ending"]["reason"] == "answers_lost"
    lost = np.asarray(run.signals["link.lost"])
    begin = len(lost) - int(lost[-1])
    speed = commanded(run, "velocity")[begin : len(lost), 0]
    assert np.array_equal(speed[:STOP_AFTER], np.full(STOP_AFTER, 0.3))
    step = 1e-3 * program_of(VELOCITIES).context.drives.rates[0]
    assert speed[STOP_AFTER] == pytest.approx(0.3 - step)
    assert 0.0 < step <= STEP
    assert speed[-1] == 0.0
