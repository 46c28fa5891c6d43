"""Where a stage by itself leaves a doubt of how it ends."""

from __future__ import annotations

import math

import pytest

from taskspec.examination import examine
from taskspec.foresight.doubts import _falls
from taskspec.geometry.axis import Axis
from taskspec.laws.gains import on_axis
from taskspec.program.plan import StagePlan
from taskspec.spec import load_text

PRESS = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 320 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 100 kN/m, damping: 30 N*s/m}}
frame: table
law: LAW
stages:
  go: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -2 N, within: 3 s}
  press: {axes: {z: {force: -10 N}}, time: 1 s}
"""


def stage_of(name: str, law: str) -> StagePlan:
    plan = examine(load_text(PRESS.replace("LAW", law), "t.yaml")).plan
    assert plan is not None
    return plan.stages[name]


@pytest.mark.parametrize("law", ["hybrid", "parallel"])
def test_a_tool_that_was_lifted_off_falls_back_at_the_speed_of_its_damper(law: str) -> None:
    """f/d sqrt(h k): 10 N against a damper of 1.05 kN s/m."""
    press = stage_of("press", law)
    d = press.law.control_law.loop_damping(on_axis(press.gains, Axis.Z))
    # The mass that an impedance is designed with is the effective one at the tip [kg].
    h = on_axis(stage_of("press", "impedance").gains, Axis.Z)["mass"]
    assert _falls(press) == pytest.approx(10 / d * math.sqrt(h * 100e3), rel=1e-6)
    assert 5 < _falls(press) < 6


def test_nothing_falls_without_a_force_loop_or_a_set_point() -> None:
    assert _falls(stage_of("press", "impedance")) == 0
    assert _falls(stage_of("go", "hybrid")) == 0
