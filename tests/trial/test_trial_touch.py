"""Stages that meet a surface: what their trial comes to."""

from __future__ import annotations

import pytest
from trials import found, serious

TASK = """
taskspec: 1
name: meets
robot: {model: panda, start: {xyz: [500 mm, 0, 320 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 200 kN/m, damping: 30 N*s/m}}
frame: table
law: LAW
limits: {force: LIMIT}
stages:
  go:
    axes: {z: {velocity: SPEED}}
    until: force.z < -2 N for 10 ms
    within: {WITHIN}
  press: {axes: {z: {force: -3 N}}, time: 0.2 s}
"""
GOOD = {"LAW": "hybrid", "LIMIT": "60 N", "SPEED": "-30 mm/s", "WITHIN": "time: 3 s"}


def text(**changes):
    filled = TASK
    for key, value in (GOOD | changes).items():
        filled = filled.replace(key, value)
    return filled


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, []),
        ({"SPEED": "-100 mm/s"}, ["TS616"]),
        ({"SPEED": "-300 mm/s"}, ["TS616"]),
        ({"SPEED": "-300 mm/s", "LIMIT": "400 N"}, []),
        ({"WITHIN": "travel: 15 mm"}, ["TS617"]),
        ({"WITHIN": "travel: 25 mm"}, []),
        ({"WITHIN": "time: 0.5 s"}, ["TS617"]),
    ],
)
def test_meeting_a_surface(changes, expected):
    assert serious(text(**changes)) == expected


@pytest.mark.parametrize("law", ["hybrid", "parallel", "impedance"])
def test_a_touch_that_is_too_fast_names_the_speed_that_is_not(law):
    """The hint's speed passes the limit no more."""
    fast = text(LAW=law, SPEED="-150 mm/s", LIMIT="40 N")
    hint = found(fast, "TS616").hint
    slower = hint.removeprefix("come there with ").partition(" or less")[0]
    assert slower.endswith(" mm/s")
    assert serious(text(LAW=law, SPEED=f"-{slower}", LIMIT="40 N")) == []


def test_a_touch_that_has_pressed_on_fails_what_comes_next():
    """The next stage begins with what the touch came to, and fails before that is taken back."""
    task = text().replace("for 10 ms", "for 0.3 s").replace("200 k", "50 k")
    task = task.replace("time: 0.2 s}", "time: 0.2 s, fail_if: abs(force.z) > 8 N for 10 ms}")
    assert serious(task) in (["TS618"], ["TS613"])
