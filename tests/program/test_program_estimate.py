"""Frames that are felt: measured at a stage's end, used by the stages that follow."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.examination import check_task
from taskspec.program.world import estimated_frames
from taskspec.program.world.frames import FrameModel
from taskspec.spec import load_text
from taskspec_runner.verdict.replay import Replay

ANGLE = 20.0
PLANAR = """
taskspec: 1
name: feel
robot: {{model: planar2, start: {{xyz: [365 mm, 100 mm, 0]}}}}
world: {{wall: {{shape: plane, xyz: [370 mm, 100 mm, 0], rpy: [0, -90 deg, {angle} deg]}}}}
frames:
  felt: {{estimate: touch, heading: [0, 1, 0]}}
  beside: {{parent: felt, xyz: [10 mm, 0, 20 mm], rpy: [0, 90 deg, 0]}}
law: parallel
stages:
  touch: {{axes: {{x: {{velocity: 20 mm/s, force: 0}}, y: {{force: 0}}}}, time: 1 s}}
{stages}
"""
PRESS = "  press: {frame: felt, axes: {x: {position: 0}, z: {force: -5 N}}, time: 3 s}"


def planar(stages: str = PRESS, angle: float = ANGLE) -> str:
    return PLANAR.format(angle=angle, stages=stages)


def outward(angle: float = ANGLE):
    """The wall's normal: -x, turned about z."""
    a = np.deg2rad(angle)
    return -np.array([np.cos(a), np.sin(a), 0.0])


def replayed(run):
    return Replay(
        run.program.context.robot, run.program.context.frames, run.program.stages, run.history
    )


@pytest.mark.parametrize("angle", [-20.0, 0.0, 20.0])
def test_z_is_the_outward_normal_and_the_force_goes_there(simulate, angle):
    run = simulate(planar(angle=angle))
    assert run.outcome.status == "done"
    # A frictionless contact feels along its normal alone, so the frame is exact; what is left
    # of 5 N after 3 s is the force loop settling: 4e-6 N after 2 s.
    assert run["force.z"][-1] == pytest.approx(-5.0, abs=1e-6)
    assert run["force.x"][-1] == pytest.approx(0.0, abs=1e-6)
    world = replayed(run)
    applied = np.array([world.signal("force", a, "world")[-1] for a in "xyz"])
    np.testing.assert_allclose(applied, -5.0 * outward(angle), atol=1e-6)


def test_the_origin_is_the_tip_at_the_stages_end(simulate):
    run = simulate(planar())
    first = np.flatnonzero(run.history.window("press"))[0]
    assert run["position.x"][first] == pytest.approx(0.0, abs=1e-12)
    assert run["position.z"][first] == pytest.approx(0.0, abs=1e-12)


def test_replay_finds_the_frame_again_from_the_log(simulate):
    run = simulate(planar())
    replay = replayed(run)
    window = run.history.window("press")
    for name, axis in (("force", "z"), ("velocity", "x"), ("position", "z")):
        logged = run[f"{name}.{axis}"][window]
        found = replay.signal(name, axis, "felt")[window]
        np.testing.assert_allclose(found, logged, rtol=1e-9, atol=1e-12)
    # Before it has been felt it has no value.
    assert np.isnan(replay.signal("force", "z", "felt")[: np.flatnonzero(window)[0]]).all()


def test_a_frame_placed_in_a_felt_one(simulate):
    stages = (
        PRESS
        + "\n  go: {frame: beside, axes: {x: {force: 5 N}, z: {velocity: -5 mm/s}}, time: 1 s}"
    )
    run = simulate(planar(stages))
    assert run.outcome.status == "done"
    replay = replayed(run)
    window = run.history.window("go")
    # Turned by 90 deg about the common y: its x is along -z of the felt one, its z along x.
    np.testing.assert_allclose(
        run["force.x"][window], -replay.signal("force", "z", "felt")[window], atol=1e-9
    )
    np.testing.assert_allclose(
        run["position.x"][window], 0.02 - replay.signal("position", "z", "felt")[window], atol=1e-9
    )
    np.testing.assert_allclose(
        replay.signal("position", "z", "beside")[window], run["position.z"][window], atol=1e-9
    )


def test_guards_read_a_felt_frame_from_elsewhere(simulate):
    stages = """
  press:
    axes: {x: {force: 3 N}, y: {force: 0}}
    until: force.z in felt < -2.5 N
    within: {time: 1 s}
"""
    run = simulate(planar(stages))
    assert run.transitions[-1].kind == "until"


def test_every_visit_measures_again(simulate):
    stages = """
  press: {frame: felt, axes: {z: {force: -5 N}}, time: 0.2 s}
  slide: {frame: felt, axes: {x: {velocity: 30 mm/s}, z: {force: -5 N}}, time: 0.5 s, next: again}
  again: {time: 0.1 s, attempts: 2, next: touch}
"""
    text = planar(stages).replace("time: 1 s}", "time: 1 s, attempts: 2}")
    run = simulate(text)
    starts = [v.first for v in run.history.visits() if v.stage == "press"]
    assert len(starts) == 2
    for row in starts:
        assert run["position.x"][row] == pytest.approx(0.0, abs=1e-12)


def test_a_frame_that_was_not_felt_stops_the_run(simulate):
    text = planar().replace("velocity: 20 mm/s", "velocity: -20 mm/s")
    run = simulate(text)
    assert (run.outcome.status, run.outcome.reason) == ("stopped", "frame_not_felt")
    assert "less than 0.5 N" in run.outcome.text
    assert run.transitions[-1].stage == "touch"


def test_a_stage_entered_past_its_measurement_stops_the_run(simulate):
    stages = "  first: {time: 50 ms, next: press}\n  touch:"
    text = planar().replace("  touch:", stages, 1).replace("time: 1 s}", "time: 1 s, attempts: 2}")
    run = simulate(text + "  again: {time: 10 ms, next: touch, attempts: 1}\n")
    assert run.outcome.reason == "frame_not_felt"
    assert "stage 'touch' has not been visited" in run.outcome.text


@pytest.mark.parametrize(
    ("code", "old", "new"),
    [
        ("TS245", "estimate: touch", "estimate: press"),
        ("TS245", "stages:", "stages:\n  early: {frame: felt, time: 1 s}"),
        ("TS245", "velocity: 20 mm/s", "velocity: 20 mm/s + force.z in felt * 1 mm/N/s"),
        ("TS246", "stages:", "stages:\n  early: {time: 1 s, on_fail: press}"),
        ("TS225", "heading: [0, 1, 0]", "heading: [1, 0, 0]"),
    ],
)
def test_what_is_known_before_the_run(code, old, new):
    unused = "  beside: {parent: felt, xyz: [10 mm, 0, 20 mm], rpy: [0, 90 deg, 0]}\n"
    text = planar(angle=0).replace(unused, "")
    assert [d.code for d in check_task(load_text(text, "task.yaml"))] == []
    changed = text.replace(old, new, 1)
    assert code in [d.code for d in check_task(load_text(changed, "task.yaml"))]


def test_the_pose_that_is_measured():
    frame = FrameModel("felt", "estimated", np.eye(3), np.zeros(3), estimate="touch")
    normal = np.array([0.3, 0.1, 0.9])
    R, origin = estimated_frames.measure(frame, 4.0 * normal, np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(R) == pytest.approx(1.0)
    np.testing.assert_allclose(R[:, 2], normal / np.linalg.norm(normal))
    # x is the world's x laid on the tangent plane: nothing of it is across.
    assert R[0, 0] > 0
    assert R[:, 1] @ [1.0, 0.0, 0.0] == pytest.approx(0.0, abs=1e-15)
    np.testing.assert_array_equal(origin, [1.0, 2.0, 3.0])
    with pytest.raises(estimated_frames.NotEstimatedError, match="less than"):
        estimated_frames.measure(frame, 0.1 * normal, origin)
    with pytest.raises(estimated_frames.NotEstimatedError, match="heading"):
        estimated_frames.measure(frame, np.array([5.0, 0.1, 0.0]), origin)


def test_the_force_is_averaged_over_the_last_tenth_of_a_second():
    frame = FrameModel(
        "felt", "estimated", np.eye(3), np.zeros(3), estimate="s", estimated_in="felt"
    )
    store = estimated_frames.Estimates([frame], 1e-3)
    for k in range(300):
        store.collect(np.array([0.0, 0.0, 1.0]) if k >= 200 else np.array([0.0, 9.0, 0.0]))
    store.end("other", np.zeros(3))
    assert not store.pose("estimated.felt").any()
    store.end("s", np.zeros(3))
    np.testing.assert_allclose(store.pose("estimated.felt")[6:9], [0.0, 0.0, 1.0])
