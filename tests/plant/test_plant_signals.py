"""The true signals of every kind of object in the log."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.geometry.rotation import from_rpy
from taskspec.program.signals import entry_of

TASK = """
taskspec: 1
name: signals
robot:
  model: panda
  start: {xyz: [620 mm, 0, 400 mm]}
  grasp: crank.handle
  tool: {mass: 300 g}
world:
  crank: {mechanism: hinge, xyz: [500 mm, 0, 400 mm], handle: [120 mm, 0, 0], knob: free,
          inertia: 0.02 kg*m^2, damping: 0.1 N*m*s/rad}
  nut: {mechanism: screw, xyz: [2 m, 0, 0], pitch: 2 mm/turn}
  drawer: {mechanism: slide, xyz: [2 m, 0, 1 m]}
  ramp: {equation: "2*y = 10 mm", stiffness: 200 N/m}
  tie: {equation: "q1 = q2", stiffness: 1 N*m/rad}
  belt: {shape: plane, xyz: [0, 0, 100 mm], rpy: [0, 30 deg, 0],
         motion: {x: 50 mm/s * clock, z: 20 mm * sin(clock * 3 rad/s), rx: 0.2 rad/s * clock}}
  ball: {shape: sphere, xyz: [620 mm, 300 mm, 2 m], radius: 20 mm, free: true, mass: 100 g}
law: impedance
stages: {swing: {axes: {y: {move: 20 mm}}, time: 0.4 s}}
"""


@pytest.fixture
def run(simulate):
    return simulate(TASK)


def test_every_kind_has_its_signals_in_its_unit(run):
    expected = {
        "crank.angle": "rad", "crank.torque": "N*m",
        "nut.angle": "rad", "nut.travel": "m", "nut.torque": "N*m",
        "drawer.travel": "m", "drawer.force": "N",
        "ramp.gap": "m", "ramp.force": "N", "ramp.force.ref": "N", "ramp.force.measured": "N",
        "tie.gap": "rad", "tie.torque": "N*m",
        "tie.torque.ref": "N*m", "tie.torque.measured": "N*m",
        "belt.gap": "m", "belt.force": "N",
        "ball.gap": "m", "ball.force": "N",
    }  # fmt: skip
    objects = ("crank", "nut", "drawer", "ramp", "tie", "belt", "ball")
    found = {n: u for n, u in run.history.units.items() if n.partition(".")[0] in objects}
    assert found == expected


def test_the_handle_turns_as_far_as_the_tool_takes_it(run):
    # The tool is at the handle, within force / 50 kN/m, at the same tick.
    angle = np.arctan2(run["position.y"], run["position.x"] - 0.5)
    assert run["crank.angle"][-1] > 0.09
    np.testing.assert_allclose(run["crank.angle"], angle, atol=20 / 50e3 / 0.12)
    acceleration = np.gradient(np.gradient(run["crank.angle"], 1e-3), 1e-3)
    rate = np.gradient(run["crank.angle"], 1e-3)
    inner = slice(20, -20)
    balance = (0.02 * acceleration + 0.1 * rate)[inner]
    np.testing.assert_allclose(run["crank.torque"][inner], balance, atol=0.02)


def test_equations_have_distance_and_force_along_their_unit_gradient(run):
    np.testing.assert_allclose(run["ramp.gap"], run["position.y"] - 5e-3, atol=1e-12)
    rate = run["velocity.y"]
    damping = 0.1 * 2 * np.sqrt(200.0)
    np.testing.assert_allclose(run["ramp.force"], 200 * run["ramp.gap"] + damping * rate, atol=1e-9)
    q1, q2 = run["joint.1.position"], run["joint.2.position"]
    np.testing.assert_allclose(run["tie.gap"], (q1 - q2) / np.sqrt(2), atol=1e-12)


def test_gaps_are_to_where_moving_and_loose_shapes_are(run):
    clock = run["clock"]
    R = from_rpy((0, np.pi / 6, 0))
    p = np.column_stack([run[f"position.{a}"] for a in "xyz"])
    tool = p + np.array([0.0, 0.0, 0.01])  # the ball's centre: the tool points down, to 1e-3 rad
    shift = np.column_stack([0.05 * clock, 0 * clock, 0.02 * np.sin(3 * clock)])
    normal = np.column_stack([0 * clock, -np.sin(0.2 * clock), np.cos(0.2 * clock)])
    local = (tool - [0, 0, 0.1]) @ R - shift
    gap = np.einsum("ki,ki->k", local, normal) - 0.01
    np.testing.assert_allclose(run["belt.gap"], gap, atol=1e-4)
    # A ball that falls: the step's first velocity is g T.
    height = 2.0 - 0.5 * 9.81 * clock * (clock + 1e-3)
    centre = np.column_stack([0.62 + 0 * clock, 0.3 + 0 * clock, height])
    gap = np.linalg.norm(centre - tool, axis=1) - 0.03
    np.testing.assert_allclose(run["ball.gap"], gap, atol=1e-4)


def test_signals_stay_within_the_bounds_of_their_nature(simulate):
    run = simulate("door-hinge")
    task, columns = run.program.context.loaded.task, run.history.columns
    looked = 0
    for name, values in columns.items():
        found = entry_of(task, tuple(name.split(".")))
        known = values[np.isfinite(values)]
        if found is not None and known.size:
            assert found.signal.low <= known.min() <= known.max() <= found.signal.high, name
            looked += np.isfinite(found.signal.low)
    assert looked >= 5
