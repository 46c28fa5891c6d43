"""Motions of joints that a file states: how they start, what follows them, and constraints."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.compiler import compile_task
from taskspec.program.walk.joint_walk import joint_states
from taskspec.spec import load_text
from taskspec_runner import run

TASK = """\
taskspec: 1
name: sway
robot: {model: planar2, start: {joints: [START, 60 deg]}}
stages:
  sway: {path: {joints: ["30 deg + 10 deg*sin(2*pi*TIME/(1 s))", 60 deg], time: 1 s}}
  back: {path: {joints: ["20 deg*cos(2*pi*clock/(1 s))", 50 deg], time: 2 s}}
"""
RAIL = """\
taskspec: 1
name: on-the-rail
robot: {model: planar2, start: {joints: [START]}}
world: {rail: {equation: "x = 400 mm", stiffness: 20 kN/m}}
law: hybrid-multipliers
stages:
  press: {constraints: {rail: {force: 10 N}}, axes: {y: hold}, time: 0.3 s}
  across:
    constraints: {rail: {force: 10 N}}
    path: {joints: [-9 deg, 80 deg], speed: 20 deg/s}
"""


def swayed(start="30 deg", time="t"):
    return load_text(TASK.replace("START", start).replace("TIME", time), "t")


def reference(result, joint):
    return result.column(f"joint.{joint}.position.ref")


def test_it_starts_from_rest_in_a_time_of_its_own():
    """From 0.2 s on it is 0.1 s behind, and it lasts so much longer."""
    result = run(swayed())
    assert result.summary["status"] == "done", result.reason
    t, q_d = result.column("t"), reference(result, 1)
    first = result.column("clock") < 1.09
    late = first & (t > 0.2)
    stated = np.radians(30 + 10 * np.sin(2 * np.pi * (t[late] - 0.1)))
    assert np.abs(q_d[late] - stated).max() < 1e-12
    assert abs(np.diff(q_d[:3]) / 1e-3).max() < 0.01
    assert result.visits[0].end == pytest.approx(1.1, abs=2e-3)
    assert result.column("joint_error").max() < np.radians(0.2)


def test_a_start_elsewhere_is_blended_out_and_waited_for():
    result = run(swayed("50 deg"))
    first = result.column("clock") < result.visits[0].end - 1e-4
    q_d, t = reference(result, 1)[first], result.column("t")[first]
    waits = 1.875 * 20 / 30
    assert q_d[0] == pytest.approx(np.radians(50), abs=1e-12)
    rates = np.diff(q_d[t < waits][:-1]) / 1e-3
    assert np.abs(rates).max() == pytest.approx(np.radians(30), rel=1e-3)
    assert q_d[np.searchsorted(t, waits)] == pytest.approx(np.radians(30), abs=1e-6)
    assert result.visits[0].end == pytest.approx(waits + 1.1, abs=2e-3)


def test_by_the_clock_its_phase_is_kept():
    """It begins in motion: what it is off is caught up with in 1 s, and it lasts its time."""
    result = run(swayed())
    clock, q_d = result.column("clock"), reference(result, 1)
    stated = np.radians(20 * np.cos(2 * np.pi * clock))
    assert abs(q_d[-1] - stated[-1]) < 1e-4
    second = result.visits[1]
    assert second.end - second.start == pytest.approx(2.0, abs=2e-3)
    k = np.flatnonzero(clock > 1.1)[1]
    assert q_d[k] == pytest.approx(q_d[k - 1], abs=0.01)


def test_what_is_predicted_is_what_is_followed():
    loaded = swayed("50 deg")
    plan = compile_task(loaded).plan.stages["sway"]
    result = run(loaded)
    states = joint_states(plan.joint_path, plan.context.start)
    assert len(states) > 10
    for state in states[:-1]:
        row = round(state.time / 1e-3)
        off = state.q[0] - reference(result, 1)[row]
        assert abs(off - state.v[0] * (state.time - row * 1e-3)) < 1e-5


def test_a_path_to_targets_goes_along_a_rail():
    """Joints that leave the rail give way, and none else: the tip stays and the force is held."""
    start = np.degrees([np.arccos(0.4 / (0.6 * np.cos(np.radians(35)))) - np.radians(35),
                        np.radians(70)])  # fmt: skip
    loaded = load_text(RAIL.replace("START", f"{start[0]} deg, {start[1]} deg"), "t")
    result = run(loaded)
    assert result.summary["status"] == "done", result.reason
    across = result.column("t").size - 300
    off = result.column("rail.gap.ref")[-across:]
    assert np.nanmax(np.abs(off)) > 4e-3
    assert np.isnan(result.column("rail.gap.ref")[:200]).all()
    assert np.abs(result.column("rail.gap")).max() < 1.5e-3
    assert np.abs(result.column("rail.force")[-400:] - 10).max() < 1
    steps = np.abs(np.diff([result.column(f"joint.{i}.torque") for i in (1, 2)], axis=1))
    assert steps[:, 350:].max() < 0.1
    errors = [np.abs(reference(result, i) - result.column(f"joint.{i}.position"))[-1]
              for i in (1, 2)]  # fmt: skip
    assert min(errors) < np.radians(0.1) < max(errors)


@pytest.mark.parametrize("law", ["hybrid-multipliers", "hybrid-reaction"])
def test_the_law_of_a_stage_has_its_bandwidth(law):
    text = TASK.replace("START", "30 deg").replace("TIME", "t")
    text = text.replace("sway: {path", f"sway: {{law: {{kind: {law}, bandwidth: 9 Hz}}, path")
    gains = compile_task(load_text(text, "t")).plan.stages["sway"].gains
    w = 2 * np.pi * 9
    assert [g.value for g in gains["K_P"].values()] == pytest.approx([w**2] * 2)
