"""Guards against the noise and the bias of the sensor."""

from __future__ import annotations

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
name: noisy
robot:
  model: panda
  start: {xyz: [500 mm, 0, 320 mm]}
  sensor: {SENSOR}
world: {table: {shape: plane, xyz: [0, 0, 300 mm]}}
frame: table
stages:
  BEFORE
  touch: {axes: {z: {velocity: -20 mm/s}}, until: TOUCH, within: {time: 3 s}}
  press: {axes: {z: {force: -5 N}}, until: PRESS, within: {time: 3 s}}
"""
GOOD = {
    "SENSOR": "noise: 0.1 N",
    "BEFORE": "",
    "TOUCH": "force.z < -2 N",
    "PRESS": "abs(force.z + 5 N) < 0.5 N for 50 ms",
}


def task(**changes):
    text = TASK
    for key, value in (GOOD | changes).items():
        text = text.replace(key, value)
    return text


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, []),
        ({"TOUCH": "force.z < -0.3 N"}, ["TS614"]),
        ({"TOUCH": "norm(force) > 0.35 N"}, ["TS614"]),
        ({"TOUCH": "abs(force.z) > 0.3 N"}, ["TS614"]),
        # One in 740 readings, and eleven in a row never.
        ({"TOUCH": "force.z < -0.3 N for 10 ms"}, []),
        ({"TOUCH": "force.z < -0.3 N", "SENSOR": "noise: 0.1 N, filter: 20 Hz"}, []),
        ({"SENSOR": "bias: [0, 0, 3 N, 0, 0, 0]"}, ["TS614"]),
        ({"SENSOR": "bias: [0, 0, -3 N, 0, 0, 0]"}, []),
        ({"SENSOR": "bias: [0, 0, 3 N, 0, 0, 0]", "BEFORE": "zero: {tare: true, time: 1 s}"}, []),
        ({"PRESS": "abs(force.z + 5 N) < 0.1 N for 50 ms"}, ["TS614"]),
        ({"PRESS": "force.z within -5.1..-4.9 N for 50 ms"}, ["TS614"]),
        ({"PRESS": "abs(force.z + 5 N) < 0.1 N"}, []),
    ],
)
def test_guards(changes, expected):
    assert [d.code for d in check_task(load_text(task(**changes), "t"))] == expected


def test_a_run_ends_by_noise_alone_where_it_is_said(simulate):
    """With 20 mm to go at 20 mm/s the touch takes 1 s; noise of 0.1 N ends it far sooner."""
    run = simulate(task(TOUCH="force.z < -0.3 N", PRESS="t > 10 ms"))
    assert run["clock"][-1] < 0.9
    run = simulate(task(TOUCH="force.z < -0.3 N for 10 ms", PRESS="t > 10 ms"))
    assert run["clock"][-1] > 0.9
