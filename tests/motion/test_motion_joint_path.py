"""Paths of joints: when each joint is where, in numbers and as expressions."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from taskspec.motion.joint_path import JointPath
from taskspec.motion.profile import RISE_TIME

START = np.array([0.1, -0.4, 1.0])
TARGETS = ((0.6, -0.4, 0.2), (0.6, 0.1, 0.25))
SPEED = 0.5


def along(path, start=START, looks=20001):
    """Times (k,) and joint positions (k, n) of a path."""
    timing = path.timing(start)
    times = np.linspace(0.0, float(timing.rests), looks)
    return times, np.array([path.at(start, timing(t)) for t in times.tolist()])


def test_the_longest_way_goes_at_the_speed_and_the_others_arrive_with_it():
    """A trapezoid with rounded edges lasts |d| / v + T, closed form of `profile.move`."""
    path = JointPath(TARGETS[:1], speed=SPEED)
    times, q = along(path)
    assert times[-1] == pytest.approx(0.8 / SPEED + RISE_TIME, rel=1e-12)
    rate = np.gradient(q, times, axis=0)
    # Differences of a rate that is smooth are off by the step's square.
    assert np.abs(rate).max(axis=0) == pytest.approx([SPEED * 5 / 8, 0.0, SPEED], abs=1e-6)
    bend = np.abs(np.gradient(rate, times, axis=0)).max()
    assert bend <= 2 * SPEED / RISE_TIME * (1 + 1e-3)
    assert bend >= 2 * SPEED / RISE_TIME * (1 - 1e-2)
    share = (q - START) / (np.array(TARGETS[0]) - START + np.array([0, 1, 0]))
    assert share[:, 0] == pytest.approx(share[:, 2], abs=1e-12)


def test_it_rests_at_each_target():
    path = JointPath(TARGETS, speed=SPEED)
    first = 0.8 / SPEED + RISE_TIME
    second = 0.5 / SPEED + RISE_TIME
    timing = path.timing(START)
    assert float(timing.rests) == pytest.approx(first + second, rel=1e-12)
    assert path.at(START, timing(first)) == pytest.approx(TARGETS[0], abs=1e-12)
    h = 1e-4
    # The jerk 4 v/T^2 leads away from it by j h^3 / 6.
    near = 4 * SPEED / RISE_TIME**2 * h**3
    for t in (first - h, first + h):
        assert path.at(START, timing(t)) == pytest.approx(TARGETS[0], abs=near)
    assert path.at(START, timing(first + second)) == pytest.approx(TARGETS[1], abs=1e-12)
    times, q = along(path)
    assert np.abs(np.gradient(q, times, axis=0)).max() <= SPEED * (1 + 1e-9)


@pytest.mark.parametrize("time", [0.3, 2.0, 30.0])
@pytest.mark.parametrize("count", [1, 2])
def test_it_takes_the_time_that_it_is_given(time, count):
    path = JointPath(TARGETS[:count], time=time)
    assert float(path.timing(START).rests) == pytest.approx(time, rel=1e-12)


@pytest.mark.parametrize("pace", [{"speed": SPEED}, {"time": 3.0}])
@pytest.mark.parametrize("start", [START, np.array(TARGETS[0])])
def test_expressions_and_numbers_are_one_path(pace, start):
    """From the first target itself too: there the first piece has no length."""
    path, q = JointPath(TARGETS, **pace), ca.SX.sym("q", 3)
    symbolic = path.timing(q)
    both = ca.Function("timing", [q], [symbolic.knots, symbolic.coefficients])(start)
    knots, rows = (np.array(each) for each in both)
    timing = path.timing(start)
    assert knots.ravel() == pytest.approx(timing.knots, rel=1e-9, abs=1e-9)
    s = ca.SX.sym("s")
    place = ca.Function("at", [q, s], [path.at(q, s)])
    ends = np.linspace(0.0, float(timing.rests), 101)
    there = type(timing)(knots.ravel(), rows)
    for t in ends.tolist():
        assert np.array(place(start, there(t))).ravel() == pytest.approx(
            path.at(start, timing(t)), abs=1e-9
        )


def test_the_way_of_a_piece_is_the_slope():
    path = JointPath(TARGETS, speed=SPEED)
    for s in (0.2, 0.9, 1.3):
        slope = (path.at(START, s + 1e-6) - path.at(START, s - 1e-6)) / 2e-6
        assert path.piece(START, s) == pytest.approx(slope, abs=1e-9)
