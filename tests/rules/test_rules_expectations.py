"""Expectations that no good run can meet, or that cannot be judged."""

from __future__ import annotations

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 320 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], friction: 0.2}}
params: {press: 5 N}
frame: table
law: LAW
stages:
  touch:
    axes: {z: {velocity: -20 mm/s}}
    until: force.z < -2 N for 10 ms
    within: {time: 4 s, travel: 60 mm}
    on_fail: back
  press: {axes: {z: {force: -press}}, time: 2 s, next: end}
  back: {axes: {z: {move: 20 mm}}, next: fail}
expect: [EXPECT]
"""


def codes(*expect, law="hybrid"):
    quoted = ", ".join(f'"{e}"' for e in expect)
    loaded = load_text(TASK.replace("EXPECT", quoted).replace("LAW", law), "t")
    return [d.code for d in check_task(loaded)]


@pytest.mark.parametrize(
    ("expect", "expected"),
    [
        (["press.force.z within -press +- 0.5 N for 90 %"], []),
        (["last(back.gap) > 10 mm"], ["TS720"]),
        (["back.visits <= 0", "max(norm(force)) < 30 N"], []),
        (["rms(error.z) < 1 mm"], ["TS721"]),
        (["rms(error.x) < 1 mm", "rms(touch.error.z) < 1 mm", "max(norm(error)) < 1 m"], []),
        (["max(norm(force)) < -1 N"], ["TS722"]),
        (["touch.t > 5 s"], ["TS722"]),
        (["tilt > 190 deg"], ["TS722"]),
        (["press.force.z < -4 N", "last(press.force.z) > -3 N"], ["TS722"]),
        (["max(abs(press.position.x)) < 1 mm", "press.position.x > 2 mm"], ["TS722"]),
        (["press.position.x < 1 mm", "touch.position.x > 2 mm"], []),
        (["press.position.x < 1 mm for 40 %", "press.position.x > 2 mm for 40 %"], []),
        (["press.force.z < -6 N for 90 %"], ["TS723"]),
        (["last(press.force.z) within 5 N +- 1 N"], ["TS723"]),
        (["min(press.force.z) < -6 N"], []),
        (["last(press.t) within 2 s +- 0.2 ms"], ["TS724"]),
        (["last(press.t) within 2 s +- 2 ms"], []),
    ],
)
def test_expectations(expect, expected):
    assert codes(*expect) == expected


def test_a_force_without_a_loop_may_be_anything():
    assert "TS723" not in codes("press.force.z < -6 N", law="impedance")
