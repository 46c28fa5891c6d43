"""Signals in frames that turn with a handle or ride on an object, replayed from the log."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec_runner.verdict.replay import Replay

ORBIT = """
taskspec: 1
name: orbit
robot: {model: panda, start: {xyz: [620 mm, 0, 350 mm]}}
world:
  crank: {mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0]}
frames: {odd: {parent: crank.handle, rpy: [10 deg, 5 deg, 20 deg], xyz: [5 mm, 0, 1 mm]}}
frame: FRAME
stages:
  first: {axes: {y: {velocity: 100 mm/s}, rz: {hold: world}}, time: 0.5 s}
  second: {axes: {y: {velocity: 300 mm/s}, rz: {hold: world}}, time: TIME}
"""

RIDE = """
taskspec: 1
name: ride
robot: {model: panda, start: {xyz: [500 mm, 0, 400 mm]}}
world:
  drum:
    shape: cylinder
    xyz: [500 mm, 0, 180 mm]
    rpy: [0, 90 deg, 0]
    radius: 180 mm
    length: 600 mm
    motion: {rz: 0.3 rad/s * clock, z: 30 mm/s * clock}
frames: {skin: {surface: drum}}
frame: FRAME
stages:
  along: {axes: {x: {velocity: 20 mm/s}, y: {velocity: 10 mm/s}}, time: 0.5 s}
  world: {frame: world, axes: {}, time: 0.3 s}
"""


def replay_of(run):
    context = run.program.context
    stages, bases = run.program.stages, context.moving_bases
    return Replay(context.robot, context.frames, stages, run.history, bases)


@pytest.mark.parametrize(("frame", "time"), [("crank.handle", "2 s"), ("odd", "0.4 s")])
def test_a_handles_frame_is_replayed_as_it_was_logged(simulate, frame, time):
    """Through most of a turn, over a stage change; both from the same joint positions."""
    run = simulate(ORBIT.replace("FRAME", frame).replace("TIME", time))
    assert run.outcome.status == "done"
    replay, model = replay_of(run), run.program.context.frames
    place, turning = replay._place(model[frame]), replay._turning(model[frame])
    # The controller counts rotations from the reference that it carries on, the replay from the
    # tool: they differ by the tracking error at a stage's entry, which a rotation vector near half
    # a turn shows (pi/2) / sin(pi/2) times as large.
    entry = run.history.window("first").sum()
    late = np.linalg.norm([run[f"error.r{axis}"][entry] for axis in "xyz"])
    assert late < 1e-4
    for i, axis in enumerate("xyz"):
        np.testing.assert_allclose(place[:, i], run[f"position.{axis}"], atol=1e-12)
        np.testing.assert_allclose(turning[:, i], run[f"position.r{axis}"], atol=1.6 * late)


@pytest.mark.parametrize("frame", ["drum", "skin"])
def test_a_frame_that_rides_along_is_replayed_as_it_was_logged(simulate, frame):
    run = simulate(RIDE.replace("FRAME", frame).replace("  world:", "  still:"))
    assert run.outcome.status == "done"
    replay, model = replay_of(run), run.program.context.frames
    rows = run.history.window("along")
    place, turning = replay._place(model[frame])[rows], replay._turning(model[frame])[rows]
    for i, axis in enumerate("xyz"):
        if (frame, axis) != ("skin", "z"):  # The gap, which is the log's own.
            np.testing.assert_allclose(place[:, i], run[f"position.{axis}"][rows], atol=1e-12)
        np.testing.assert_allclose(turning[:, i], run[f"position.r{axis}"][rows], atol=1e-11)
    # Against the world, and back again: the later stage's world velocity against the drum.
    tip = replay.tip_pose()[0]
    moved = np.gradient(tip, 1e-3, axis=0)
    for i, axis in enumerate("xyz"):
        seen = replay.signal("velocity", axis, "world")
        # A step takes the velocity at its end: T/2 of an acceleration of at most 2 m/s^2.
        np.testing.assert_allclose(seen[2:-2][rows[2:-2]], moved[2:-2, i][rows[2:-2]], atol=1e-3)
