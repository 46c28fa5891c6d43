"""TS506 against runs: a press on a surface that holds the tool, on either side of the boundary."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.examination import check_task
from taskspec.program.plan import StagePlan
from taskspec.program.prepare import prepare
from taskspec.program.stages.stage import compile_stage
from taskspec.spec import load_text
from taskspec.stability.margin import Search
from taskspec.stability.sampled_stage import analyse

PRESS = """
taskspec: 1
name: sticking
robot:
  model: ur5e
  tool: {{shape: sphere, radius: 10 mm, length: 120 mm, mass: 300 g}}
  start: {{xyz: [450 mm, 100 mm, 209.5 mm]}}
  sensor: {{{sensor}}}
world: {{table: {{shape: plane, xyz: [0, 0, 200 mm], stiffness: {stiffness}, friction: 0.5}}}}
frames: {{task: {{surface: table}}}}
frame: task
law: {{kind: hybrid, force: {{integral: {integral} /s, damping: {damping} N*s/m}}}}
stages:
  press: {{axes: {{z: {{force: -20 N}}}}, time: 6 s}}
"""
CASES = (
    {"sensor": "at: wrist, delay: 8 ms, filter: 60 Hz", "stiffness": "40 kN/m", "damping": 400},
    {"sensor": "at: wrist, delay: 4 ms", "stiffness": "40 kN/m", "damping": 200},
    {"sensor": "at: wrist, delay: 8 ms, filter: 60 Hz", "stiffness": "10 kN/m", "damping": 200},
)


def largest_integral(case):
    """The predicted boundary of the integral gain [1/s] while the tool sticks, and slides."""
    context = prepare(load_text(PRESS.format(integral=20, **case), "task.yaml"))
    seen = analyse(compile_stage(StagePlan(context, "press")))
    stuck, sliding = (
        Search(context, s).gain("force.integral", ["z"]) for s in (seen.stuck(), seen)
    )
    return stuck.value, sliding.value


@pytest.mark.parametrize("case", CASES, ids=lambda c: f"{c['sensor']}-{c['stiffness']}")
def test_a_tool_that_sticks_swings_past_the_boundary_only(simulate, case):
    """5 % inside, a swing dies away; 5 % outside it stays, though without friction it would not.

    From the second second on; the first has the arrival in it.
    """
    stuck, sliding = largest_integral(case)
    assert stuck < 0.9 * sliding
    swings = []
    for factor in (0.95, 1.05):
        force = simulate(PRESS.format(integral=factor * stuck, **case))["force.z"]
        swings.append([np.ptp(force[second * 1000 :][:1000]) for second in (2, 5)])
    (early, late), (before, after) = swings
    assert late < early / 3
    assert after > before / 1.5
    assert after > 10


HELD = """
taskspec: 1
name: held
robot:
  model: ur5e
  tool: {{shape: sphere, radius: 10 mm, length: 120 mm, mass: 300 g}}
  start: {{xyz: [450 mm, 100 mm, 46.86 mm]}}
world:
  ramp: {{shape: plane, xyz: [0, 0, 200 mm], rpy: [0, 20 deg, 0], stiffness: 40 kN/m, damping: 0,
          friction: {friction}}}
law: {{kind: hybrid, force: {{integral: 60 /s, damping: 100 N*s/m}}}}
stages:
  press: {{axes: {axes}, time: 3 s}}
"""
STILL, DRAWN = "{z: {force: -15 N}}", "{z: {force: -15 N}, y: {velocity: 10 mm/s}}"


def told(axes, friction):
    text = HELD.format(axes=axes, friction=friction)
    return [d.code for d in check_task(load_text(text, "held.yaml"))]


def test_a_tool_that_friction_holds_is_warned_of():
    """Sliding the integral may be 48.9 /s, sticking 111 /s: an error where nothing damps the tool.

    Across the ramp the motion axes bear what friction does not: the press alone does not slip.
    Drawn at 10 mm/s, friction is a damper across the way, mu 15 N / (10 mm/s): 750 N s/m are
    enough, 150 are not.
    """
    assert told(STILL, 0.5) == ["TS507"]
    assert told(STILL, 0) == ["TS501"]
    assert told(DRAWN, 0.5) == ["TS502"]
    assert told(DRAWN, 0.1) == ["TS501"]


def test_a_tool_that_friction_damps_across_its_way_comes_to_rest(simulate):
    """In the third second nothing moves under much friction; under little the tool bounces."""
    much, little = (
        np.ptp(simulate(HELD.format(axes=DRAWN, friction=mu))["force.z"][-1000:])
        for mu in (0.5, 0.1)
    )
    assert much < 0.01
    assert little > 15


def test_a_tool_that_friction_holds_comes_to_rest(simulate):
    """In the third second the force has 5 % of its set point with friction, and bounces without."""
    held, free = (
        np.ptp(simulate(HELD.format(axes=STILL, friction=mu))["force.z"][-1000:]) for mu in (0.5, 0)
    )
    assert held < 0.75
    assert free > 15


def test_a_tool_that_sticks_is_looked_at_for_ringing_too():
    """A tenth inside the boundary of the sticking tool it rings; the sliding one does not."""
    integral = 0.9 * largest_integral(CASES[0])[0]
    text = PRESS.format(integral=integral, **CASES[0])
    told = check_task(load_text(text, "task.yaml"))
    [found] = [d for d in told if d.code.startswith("TS5")]
    assert found.code == "TS502"
    assert "while friction holds the tool" in found.message
