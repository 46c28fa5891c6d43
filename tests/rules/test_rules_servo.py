"""What is said of servos that do not fit their robot."""

from __future__ import annotations

import pytest

from taskspec.examination import examine
from taskspec.spec import load_text


def found(robot: str, rest: str = "") -> list[tuple[str, str]]:
    text = (
        "taskspec: 1\nname: servo\nrobot: {model: panda, start: {xyz: [500 mm, 0, 400 mm]}, "
        f"{robot}}}\n{rest}\nstages: {{wait: {{time: 1 s}}}}\n"
    )
    return [
        (each.code, each.message)
        for each in examine(load_text(text, "servo.yaml")).findings
        if each.code in ("TS118", "TS414")
    ]


@pytest.mark.parametrize(
    "robot",
    [
        "balanced: false",
        "command: velocity",
        "command: position, servo: {bandwidth: 130 Hz}",
        "command: velocity, servo: panda",
        "command: velocity, servo: {stiffness: 500 N*m/rad}",
    ],
)
def test_servos_that_fit(robot):
    assert found(robot) == []


def test_as_many_values_as_joints():
    ((code, message),) = found("command: velocity, servo: {jerk: [9 rad/s^3, 9 rad/s^3]}")
    assert code == "TS414"
    assert message == "2 values for the 7 joints of 'panda'"


def test_a_bandwidth_too_high_for_the_rate():
    ((code, message),) = found("command: velocity, servo: {bandwidth: 140 Hz}")
    assert code == "TS118"
    assert "its bandwidth is too high for its rate of 1000 Hz" in message
    assert message.endswith("132 Hz would be")
    assert found(
        "command: velocity, servo: {bandwidth: 140 Hz, rate: 2 kHz}", "control: {plant_rate: 2 kHz}"
    ) == []  # fmt: skip


def test_drives_too_stiff_for_the_rate():
    """The Panda's published stiffness, on an arm without the inertia of its rotors."""
    ((code, message),) = found("command: velocity, servo: {stiffness: 2500 N*m/rad}")
    assert code == "TS118"
    assert "its stiffness is too high for its rate of 1000 Hz" in message


def test_a_servo_that_is_so_in_truth_alone():
    ((code, message),) = found("command: velocity", "truth: {robot.servo.bandwidth: 150 Hz}")
    assert code == "TS118"
    assert "bandwidth" in message


@pytest.mark.parametrize(
    "entry", ["stiffness: 10 N*m/rad .. 5 kN*m/rad", "bandwidth: 10 Hz .. 150 Hz"]
)
def test_a_servo_that_is_so_in_some_worlds_of_vary(entry):
    ((code, message),) = found("command: velocity", f"vary: {{robot.servo.{entry}}}")
    assert code == "TS118"
    assert entry.split(":")[0] in message
    assert found("command: velocity", "vary: {robot.servo.bandwidth: 10 Hz .. 30 Hz}") == []
