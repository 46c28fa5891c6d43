"""Where a stage by itself leaves a doubt of how it ends."""

from __future__ import annotations

import math

import pytest
from taskspec.foresight.doubts import _falls

from taskspec.examination import examine
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


def stage_of(name: str, law: str, text: str = PRESS) -> StagePlan:
    plan = examine(load_text(text.replace("LAW", law), "t.yaml")).plan
    assert plan is not None
    return plan.stages[name]


@pytest.mark.parametrize("contact", ["100 kN/m, damping: 30", "5 kN/m, damping: 400"])
@pytest.mark.parametrize(
    "law",
    ["hybrid", "parallel", "{kind: hybrid, force: {damping: 60 N*s/m, proportional: 0.8}}"],
)
def test_a_tool_that_was_lifted_off_falls_back_at_the_speed_of_its_damper(
    law: str, contact: str
) -> None:
    """Its equation of motion, stepped, exceeds the set point of 10 N by as much."""
    text = PRESS.replace("100 kN/m, damping: 30", contact)
    press = stage_of("press", law, text)
    gains = on_axis(press.gains, Axis.Z)
    d, loop = press.law.control_law.loop_damping(gains), 1 + gains.get("force.proportional", 0.0)
    # The mass that an impedance is designed with is the effective one at the tip [kg].
    h = on_axis(stage_of("press", "impedance", text).gains, Axis.Z)["mass"]
    k, b = press.context.compliances["table"].stiffness, press.context.compliances["table"].damping
    x, v, dt, peak = 0.0, loop * 10 / d, 2e-6, 0.0
    for _ in range(round(4 * math.sqrt(h / k) / dt)):
        c = k * x + b * v
        peak = max(peak, c)
        v += dt * (loop * (10 - c) - d * v) / h
        x += dt * v
    assert _falls(press) == pytest.approx(max(peak - 10, 0), rel=2e-3, abs=1e-3)


def test_a_damper_of_the_loop_that_lets_it_fall_fast_hardly_brakes_its_blow() -> None:
    """The blow is nearly that of an undamped mass and spring, f/d sqrt(h k), and of the push f."""
    press = stage_of("press", "{kind: hybrid, force: {damping: 20 N*s/m}}")
    h = on_axis(stage_of("press", "impedance").gains, Axis.Z)["mass"]
    blow = 10 / 20 * math.sqrt(h * 100e3)
    assert 0.9 * blow < _falls(press) < math.hypot(blow, 10)


def test_nothing_falls_without_a_force_loop_or_a_set_point() -> None:
    assert _falls(stage_of("press", "impedance")) == 0
    assert _falls(stage_of("go", "hybrid")) == 0
