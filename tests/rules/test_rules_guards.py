"""Guards that no values of their signals make hold."""

from __future__ import annotations

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 340 mm]}}
world: {WORLD}
frame: table
limits: {force: 40 N, speed: 250 mm/s}
stages:
  go: {axes: {AXES}, until: UNTIL, within: {time: 4 s, travel: 60 mm}}
"""
TABLE = "table: {shape: plane, xyz: [0, 0, 300 mm], friction: 0.2}"
CEILING = "top: {shape: plane, xyz: [0, 0, 700 mm], rpy: [180 deg, 0, 0]}"


def codes(until, axes="z: {velocity: -20 mm/s}", world=TABLE):
    text = TASK.replace("UNTIL", until).replace("AXES", axes).replace("WORLD", world)
    return [d.code for d in check_task(load_text(text, "t"))]


@pytest.mark.parametrize(
    ("until", "expected"),
    [
        ("force.z < -2 N for 10 ms", []),
        ("norm(force) > 2 N", []),
        ("norm(force) < -1 N", ["TS612"]),
        ("t > 3.9 s", []),
        ("t > 4.1 s", ["TS612"]),
        ("touching for 5 s", ["TS612"]),
        ("tilt > 190 deg", ["TS612"]),
        ("gap < 1 mm and gap > 2 mm", ["TS612"]),
        ("force.z > 2 N", ["TS612"]),
        ("2 N < force.z", ["TS612"]),
        ("force.z > 2 N or t > 3 s", []),
        # What depends on how the run goes is the trial's.
        ("force.z < -45 N", []),
        ("travel > 80 mm", []),
        ("force.z > -2 N", []),
    ],
)
def test_guards(until, expected):
    assert codes(until) == expected


def test_the_other_sign_is_right_where_something_pushes_the_other_way():
    assert codes("force.z > 2 N", world=f"{TABLE}, {CEILING}") == []
    assert codes("force.z > 2 N", axes="z: {velocity: 10 mm/s}") == []


def test_the_sign_is_told_with_what_would_be_right():
    (found,) = check_task(
        load_text(
            TASK.replace("UNTIL", "force.z >= 1.5*2 N")
            .replace("AXES", "z: {velocity: -20 mm/s}")
            .replace("WORLD", TABLE),
            "t",
        )
    )
    assert "did you mean 'force.z <= -(1.5*2 N)'?" in found.hint
