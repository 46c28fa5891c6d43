"""Frames that track the motion: their lag round a rim, what friction leaves alone, hand-over."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taskspec.examination import check_task
from taskspec.program.world import tracked_frames
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner.verdict.replay import Replay

DISC, BALL = 0.08, 0.008
RIM = """
taskspec: 1
name: rim
robot:
  model: panda
  tool: {{shape: sphere, radius: 8 mm, length: 120 mm, mass: 300 g}}
  start: {{xyz: [500 mm, -88.2 mm, 300 mm]}}
world:
  disc:
    shape: cylinder
    xyz: [500 mm, 0, 300 mm]
    radius: 80 mm
    length: 60 mm
    stiffness: 30 kN/m
    damping: 100 N*s/m
    friction: {friction}
frames: {{rim: {{track: velocity, filter: {cutoff} Hz, turn: 120 deg/s}}}}
law: {law}
frame: rim
stages:
  touch: {{axes: {{{held}, y: {{force: 10 N}}}}, time: 0.6 s}}
  around:
    axes: {{{held}, x: {{velocity: {speed} mm/s * smooth(t/(0.3 s))}}, y: {{force: 10 N}}}}
    time: {time} s
"""
HELD = "rx: {hold: world}, ry: {hold: world}, rz: {hold: world}"


def rim(speed=60.0, cutoff=4.0, friction=0.0, time=3.0, law="hybrid"):
    return RIM.format(speed=speed, cutoff=cutoff, friction=friction, time=time, law=law, held=HELD)


def led(run):
    """Angle of the tangent at the tool, and how far x lags behind it [rad], by the tick."""
    replay = Replay(
        run.program.context.robot, run.program.context.frames, run.program.stages, run.history
    )
    x = replay.pose(run.program.context.frames["rim"])[1][:, :, 0]
    p, R = replay.tip_pose()
    out = p - BALL * R[:, :, 2] - [0.5, 0.0, 0.3]
    tangent = np.unwrap(np.arctan2(out[:, 0], -out[:, 1]))
    return tangent, tangent - np.unwrap(np.arctan2(x[:, 1], x[:, 0]))


@pytest.mark.parametrize("law", ["hybrid", "parallel"])
@pytest.mark.parametrize(("speed", "cutoff"), [(40, 2.0), (80, 2.0), (60, 4.0)])
@pytest.mark.parametrize("friction", [0.0, 0.4])
def test_the_lag_behind_a_tangent_that_turns(simulate, speed, cutoff, friction, law):
    """Of its rate, whatever the friction: the tool moves along the surface."""
    run = simulate(rim(speed, cutoff, friction, law=law))
    assert run.outcome.status == "done"
    tangent, lag = (each[-500:] for each in led(run))
    rate, lag = np.polyfit(run["clock"][-500:], tangent, 1)[0], lag.mean()
    # Behind the filter and the tick; the first stage's standstill has left nothing.
    assert lag == pytest.approx(tracked_frames.lag(rate, cutoff) + rate * 1e-3, rel=0.01)
    # The tool goes at v/cos d, so sin d = kappa v/(2 pi f_c).
    free = tracked_frames.sliding_lag(speed * 1e-3 / (DISC + BALL), cutoff, 0.0)
    assert lag == pytest.approx(free, rel=0.03)


def test_once_round_and_on(simulate):
    """The frame has no heading that it could run into: 400 deg of tangent, pressed all the way."""
    run = simulate(rim(80.0, 6.0, 0.2, time=8.0))
    assert run.outcome.status == "done"
    tangent, _ = led(run)
    assert tangent[-1] - tangent[0] > math.radians(400)
    assert run["force.y"][1200:] == pytest.approx(10.0, abs=0.5)


@pytest.mark.parametrize("share", [0.6, 1.4])
def test_both_sides_of_the_boundary_of_stability(simulate, share):
    """Below sqrt(2/3) of the filter's rate x settles behind the tangent, above it runs away."""
    cutoff = 0.15
    rate = share * tracked_frames.fastest_turn(cutoff, 0.0)
    speed = rate * (DISC + BALL) * 1e3
    run = simulate(rim(speed, cutoff, time=6.0))
    lag = led(run)[1]
    predicted = tracked_frames.sliding_lag(rate, cutoff, 0.0)
    if share > 1:
        assert predicted is None
        # Past the lag at which the loop ceases to be stable, and on.
        assert np.abs(lag).max() > 1.25 * tracked_frames.stable_lag(0.0)
    else:
        assert lag[-500:] == pytest.approx(predicted, rel=0.05)


def test_at_rest_it_keeps_its_direction_and_the_next_stage_goes_on_from_there(simulate):
    rest = f"  rest: {{axes: {{{HELD}, x: hold, y: {{force: 10 N}}}}, time: 0.5 s}}\n"
    more = rest.replace("rest:", "more:").replace("x: hold", "x: {velocity: 40 mm/s}")
    run = simulate(rim(time=1.0) + rest + more)
    lag = led(run)[1]
    starts = np.flatnonzero(np.diff(run["t"]) < 0) + 1
    # It comes to rest by and by; then the filter empties to 2 mm/s, where the direction stays.
    still = lag[starts[2] - 100 : starts[2]]
    assert np.ptp(still) < math.radians(0.05)
    # Another direction than the heading's: the tangent has turned by 35 deg since.
    assert abs(lag[starts[2]] - lag[starts[2] - 1]) < math.radians(0.05)


@pytest.mark.parametrize(
    ("code", "old", "new"),
    [
        ("TS249", "velocity: 60.0 mm/s", "velocity: 1 mm/s"),
        ("TS249", "velocity: 60.0 mm/s", "velocity: -60 mm/s"),
        ("TS249", "x: {velocity: 60.0 mm/s", "z: {velocity: 60 mm/s"),
        ("TS250", "filter: 4.0 Hz", "filter: 0.1 Hz"),
        ("TS250", "turn: 120 deg/s", "turn: 20 deg/s"),
        ("TS225", "track: velocity,", "track: velocity, normal: [1, 0, 0],"),
        ("TS209", "track: velocity,", "track: velocity, xyz: [0, 0, 1 mm],"),
        ("TS209", "track: velocity,", "track: force, normal: [0, 0, 1],"),
        ("TS112", "track: velocity,", "track: velocity, floor: 1 N,"),
    ],
)
def test_what_is_known_before_the_run(code, old, new):
    text = rim()
    assert [d.code for d in check_task(load_text(text, "task.yaml"))] == []
    assert old in text
    try:
        found = check_task(load_text(text.replace(old, new), "task.yaml"))
    except SpecError as error:
        found = error.diagnostics
    assert code in [d.code for d in found]
