"""Force control that begins off its surface."""

from __future__ import annotations

import re

import numpy as np
import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

PRESS = """
taskspec: 1
name: air
robot: {model: panda, start: {xyz: [500 mm, 0, HEIGHT]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm]}}
frame: table
law: LAW
stages: {press: {axes: {z: {FORCE}}, time: 3 s}}
"""


@pytest.mark.parametrize(
    ("height", "law", "force", "expected"),
    [
        ("340 mm", "hybrid", "force: -5 N", ["TS615"]),
        ("340 mm", "parallel", "force: -5 N", ["TS615"]),
        ("340 mm", "parallel", "force: -5 N, velocity: -20 mm/s", []),
        ("340 mm", "impedance", "force: -5 N", []),
        ("340 mm", "hybrid", "force: 0", []),
        ("300.5 mm", "hybrid", "force: -5 N", []),
    ],
)
def test_force_control_in_the_air(height, law, force, expected):
    task = PRESS.replace("HEIGHT", height).replace("LAW", law).replace("FORCE", force)
    assert [d.code for d in check_task(load_text(task, "t"))] == expected


@pytest.mark.parametrize("law", ["hybrid", "parallel"])
def test_the_tool_goes_there_as_fast_as_said(simulate, law):
    task = PRESS.replace("HEIGHT", "340 mm").replace("LAW", law).replace("FORCE", "force: -5 N")
    (found,) = check_task(load_text(task, "t"))
    speed = float(re.search(r"at up to ([\d.]+) mm/s", found.message)[1]) * 1e-3
    run = simulate(task)
    # Twice f/d once the integral is full, which it is to 2 % before the tool arrives; two digits.
    assert np.max(run["speed"]) == pytest.approx(speed, rel=0.07)
