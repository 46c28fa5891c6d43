"""Paths that signals slow: the time that they go by, against their equation on what was felt."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.examination import examine
from taskspec.motion.profile import RISE_TIME, timing
from taskspec.program.reference.slowed_path import LAG
from taskspec.spec import load_text

PRESS = """
taskspec: 1
name: slowed
robot: {{model: panda, start: {{xyz: [500 mm, 0, 331 mm]}}}}
world: {{table: {{shape: plane, xyz: [0, 0, 330 mm], stiffness: 20 kN/m}}}}
limits: {{force: 60 N}}
stages:
  go:
    axes: {{z: {{force: {force}}}}}
    path: {{line: {{by: [60 mm]}}, speed: "{speed}"}}
    within: {{time: 12 s}}
expect: []
"""


def codes(text: str) -> list[str]:
    return [f.code for f in examine(load_text(text, "slowed.yaml"), stability=False).findings]


def gone(run) -> np.ndarray:
    """(k,) reference along x since the start [m]."""
    reference = run["position.x"] + run["error.x"]
    return reference - 0.5


def by_equation(force: np.ndarray, slope: float, speed: float, period: float) -> np.ndarray:
    """(k,) the way along the path by its equation, from the forces of each tick [m]."""
    along = timing(0.06, speed=speed, time=None)
    passed, share, way = 0.0, 1.0, []
    for f in force:
        way.append(0.06 * along(passed))
        wanted = np.clip(1 + f / slope, 0, 1)
        rate = np.clip((wanted - share) / LAG, -1 / RISE_TIME, 1 / RISE_TIME)
        passed += share * period + rate * period**2 / 2
        share += rate * period
    return np.array(way)


def test_the_way_is_that_of_the_equation(simulate):
    force = "-10 N - 8 N*sin(2*pi*t/(1.3 s))"
    run = simulate(PRESS.format(force=force, speed="40 mm/s * clamp(1 + force.z/(24 N), 0, 1)"))
    assert run.outcome.status == "done"
    # A tick feels what the step before it has left: the log has that of its own step.
    felt = np.concatenate([[0.0], run["force.z"][:-1]])
    way = by_equation(felt, 24.0, 0.04, 1e-3)
    # Of the blending at the start there is none: it begins at rest, where it is.
    np.testing.assert_allclose(gone(run), way, atol=2e-6)
    assert gone(run)[-1] == pytest.approx(0.06, abs=1e-6)


def test_it_stands_still_and_never_goes_back(simulate):
    force = "-10 N * smooth(t/(1 s) - 0.5) - 4 N"
    run = simulate(PRESS.format(force=force, speed="40 mm/s * clamp(1 + force.z/(9 N), 0, 1)"))
    steps = np.diff(gone(run))
    assert run.outcome.status != "done"  # `within` has ended it on the way
    assert gone(run)[-1] < 0.05
    # A reference is a measured coordinate and an error of it: rounding.
    assert steps.min() > -1e-12
    assert np.abs(steps[-2000:]).max() < 1e-9
    # As fast as 40 mm/s it never is, and its rate changes no faster than in the rise of a move:
    # 2 v/T of the plan, and v/T of the share.
    bend = np.diff(steps) / 1e-6
    assert np.abs(bend).max() < 3 * 0.04 / RISE_TIME * 1.01


def test_what_is_predicted_is_what_set_points_make_of_it(simulate):
    run = simulate(PRESS.format(force="-10 N", speed="40 mm/s * clamp(1 + force.z/(20 N), 0, 1)"))
    (stage,) = run.program.stages
    half = 0.06 / 0.02
    # Half as fast, with the ramp of the force (0.2 s) and the lag at the start, and the end of a
    # move that lasts twice as long.
    assert len(run["force.z"]) * 1e-3 == pytest.approx(half + RISE_TIME, abs=0.2)
    assert stage.plan.path_share == pytest.approx(0.5)


def test_a_least_speed_bounds_the_stage(simulate):
    """A force that lets it go at a fifth only: no `within` is asked, and it is not slower."""
    text = PRESS.replace("    within: {{time: 12 s}}\n", "").format(
        force="-20 N", speed="40 mm/s * clamp(1 + force.z/(20 N), 0.2, 1)"
    )
    assert "TS609" not in codes(text)
    assert "TS609" in codes(text.replace("0.2, 1", "0, 1"))
    # The limit on forces keeps this one above 0: 1 - 60/80.
    bounded = text.replace("clamp(1 + force.z/(20 N), 0.2, 1)", "(1 - abs(force.z)/(80 N))")
    assert "TS609" not in codes(bounded)
    run = simulate(text)
    assert run.outcome.status == "done"
    (stage,) = run.program.stages
    assert stage.plan.least_share == pytest.approx(0.2)
    shortest = timing(0.06, speed=0.04, time=None).rests
    lasts = len(run["force.z"]) * 1e-3
    # It begins at its greatest speed, the force has a ramp of 0.2 s, the rate a lag.
    assert 0.8 * shortest / 0.2 < lasts <= shortest / 0.2


def test_a_path_that_slows_with_a_force_of_none(simulate):
    """The rate of norm(force) is a number also in the air, where the force is nothing."""
    text = PRESS.format(force="-10 N", speed="40 mm/s * clamp(2 - norm(force)/(45 N), 0.1, 1)")
    run = simulate(text.replace("axes: {z: {force: -10 N}}", "axes: {z: {move: 10 mm}}"))
    assert run["touching"].sum() == 0
    assert run.outcome.status == "done"
    np.testing.assert_allclose(gone(run)[-1], 0.06, atol=1e-6)
