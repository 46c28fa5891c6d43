"""Paths that are laid when a task is compiled: their curves, and how fast they are gone along."""

from __future__ import annotations

import itertools
import math
import re

import numpy as np
import pytest

from taskspec.geometry.axis import AXES, Axis
from taskspec.geometry.rotation import quaternion, turned, vector_of
from taskspec.motion.paths import Raster, Spiral, Waypoints
from taskspec.motion.profile import RISE_TIME, PathSection, timing, timing_by_sections

ROUND = Waypoints(((0, 0, 0), (0.06, 0, 0), (0.06, 0.04, 0.01), (0, 0.04, 0.02)), 0.01)
FORMS = (
    (Raster((0.08, 0.04), 0.008), 0.05),
    (Raster((-0.03, 0.09), 0.02, "y"), 0.1),
    (Spiral(0.002, 0.012), 0.02),
    (Spiral(0.0005, 0.0041), 0.01),
    (ROUND, 0.05),
    (Waypoints(((0, 0), (0.06, 0), (0.06, 0.04))), 0.05),
)


def along(form, speed=None, time=None):
    """Times (k,) and places (d, k) of a path."""
    planned = form.timing({}, (), speed, time)
    t = np.linspace(0.0, float(planned.rests), 20001)
    s = [planned(each) for each in t]
    curves = [form.route.splines[a] for a in form.own if not a.is_rotation]
    return t, np.array([[curve(each) for each in s] for curve in curves])


@pytest.mark.parametrize(("form", "speed"), FORMS)
def test_speed_and_acceleration_stay_within_those_of_a_move(form, speed):
    t, places = along(form, speed)
    rate = np.gradient(places, t, axis=1)
    pace = np.linalg.norm(rate, axis=0)
    bend = np.linalg.norm(np.gradient(rate, t, axis=1), axis=0)
    # A cubic through places and unit tangents is as fast as its argument to 1e-5 a^2, a = 5 deg.
    assert pace.max() <= speed * (1 + 1e-5)
    # Differences over a jump of the curvature see a part of either side.
    assert bend.max() <= 2 * speed / RISE_TIME * (1 + 2e-3)
    assert pace[0] < 1e-3 * speed
    assert pace[-1] < 1e-3 * speed
    # As long as told.
    assert np.sum(np.linalg.norm(np.diff(places, axis=1), axis=0)) == pytest.approx(
        form.route.length, rel=1e-6
    )


@pytest.mark.parametrize(("form", "speed"), FORMS)
def test_a_path_takes_the_time_that_it_is_given(form, speed):
    for time in (0.5, 7.0, 60.0):
        t, _ = along(form, time=time)
        assert t[-1] == pytest.approx(time, rel=1e-12)
    # A time that a speed takes leads to that speed again, by the search's share.
    took = along(form, speed)[0][-1]
    pace = np.gradient(along(form, time=took)[1], took / 20000, axis=1)
    assert np.linalg.norm(pace, axis=0).max() == pytest.approx(speed, rel=3e-3)


def test_a_single_straight_section_is_a_move():
    for length, speed in itertools.product((1e-4, 0.004, 0.3), (0.01, 0.2)):
        one = timing_by_sections([PathSection(length)], speed=speed, time=None)
        move = timing(length, speed=speed, time=None)
        assert float(one.rests) == pytest.approx(float(move.rests), rel=1e-9)
        for t in np.linspace(0, float(move.rests), 37):
            assert one(t) == pytest.approx(move(t), abs=1e-9)


def test_a_raster_covers_its_rectangle():
    """No point of it is farther from a line than half a pitch, but for the corners of turns."""
    form = Raster((0.08, -0.04), 0.0085)
    assert form.lines == 6
    _, (x, y) = along(form, 0.05)
    assert x.min() == pytest.approx(0, abs=1e-9)
    assert x.max() == pytest.approx(0.08, abs=1e-9)
    assert y.max() == pytest.approx(0, abs=1e-9)
    assert y.min() == pytest.approx(-0.04, abs=1e-9)
    # Off the turns, whose radius is half of the distance of the lines, it is on a line.
    middle = (x > 0.0041) & (x < 0.0759)
    assert np.abs(y[middle] / 0.008 - np.round(y[middle] / 0.008)).max() < 1e-9


def test_a_spiral_is_archimedes():
    form = Spiral(0.002, 0.0125)
    _, (x, y) = along(form, 0.02)
    r, turn = np.hypot(x, y), np.unwrap(np.arctan2(y, x)[1:])
    assert r[-1] == pytest.approx(0.0125, abs=1e-12)
    # Off by r a^4/384 between its points, a = 5 deg: 2e-9 m.
    assert np.abs(r[1:] - 0.002 * turn / (2 * math.pi)).max() < 2e-9


def test_corners_are_arcs_of_their_radius():
    line = Waypoints(((0, 0), (0.06, 0), (0.06, 0.04)), 0.01)
    _, (x, y) = along(line, 0.05)
    near = (x > 0.0501) & (y < 0.0099)
    assert near.sum() > 100
    # The center lies by the radius from both legs.
    assert np.abs(np.hypot(x - 0.05, y - 0.01)[near] - 0.01).max() < 2e-9
    # Two right angles of legs 60 mm and 40 mm: pi/2 r in the place of 2 r.
    assert line.route.length == pytest.approx(0.1 - 0.02 + math.pi * 0.005, rel=1e-12)


def test_without_a_radius_it_rests_at_corners():
    form = Waypoints(((0, 0), (0.06, 0), (0.06, 0.04)))
    t, places = along(form, 0.05)
    corner = int(np.argmin(np.hypot(places[0] - 0.06, places[1])))
    assert np.hypot(places[0] - 0.06, places[1]).min() < 1e-7
    assert np.linalg.norm(np.gradient(places, t, axis=1)[:, corner]) < 1e-3 * 0.05


def test_orientations_turn_about_one_axis_without_a_jump():
    points = ((0, 0, 0, 0, 0, 0), (0.06, 0, 0, 0, 0.3, 0), (0.06, 0.04, 0, 0.5, 0.3, 2.9))
    form = Waypoints(points, 0.01)
    splines = [form.route.splines[a] for a in AXES[3:]]
    s = np.linspace(0, 1, 4001)
    vectors = np.array([[curve(each) for curve in splines] for each in s])
    steps = [
        vector_of(turned(quaternion(a), quaternion(b), back=True))
        for a, b in itertools.pairwise(vectors)
    ]
    rates = np.array(steps) / s[1]
    # C1: from one step to the next, the rate changes by no more than the smooth step bends,
    # 6 angle/leg^2 a step.
    reached = 0.055 / form.route.length
    angles = [0.3, np.linalg.norm(vector_of(turned(quaternion(np.array(points[1][3:])),
              quaternion(np.array(points[2][3:])), back=True)))]  # fmt: skip
    most = max(6 * a / leg**2 for a, leg in zip(angles, (reached, 1 - reached), strict=True))
    assert np.linalg.norm(np.diff(rates, axis=0), axis=1).max() <= 1.2 * most * s[1]
    # Between two points it turns about one axis, on the shortest way.
    first, second = np.split(rates, [int(reached * 4000) - 20])
    for part, angle in zip((first, second[60:]), angles, strict=True):
        turning = part[np.linalg.norm(part, axis=1) > 0.1 * angle]
        axes = turning / np.linalg.norm(turning, axis=1)[:, None]
        assert np.abs(axes - axes[len(axes) // 2]).max() < 1e-3  # cubics of 32 pieces: (1/32)^2
    np.testing.assert_allclose(vectors[-1], points[-1][3:], atol=1e-12)


def test_the_tool_turns_no_faster_than_a_rotation_moves():
    form = Waypoints(((0, 0, 0, 0, 0, 0), (0.06, 0, 0, 0, 0, 1.5)))
    planned = form.timing({}, (), 0.1, None)
    turn = form.route.splines[Axis.RZ]
    t = np.linspace(0, float(planned.rests), 8001)
    rates = np.gradient([turn(planned(each)) for each in t], t)
    assert np.abs(rates).max() == pytest.approx(math.radians(30), rel=1e-3)


@pytest.mark.parametrize(
    ("form", "message"),
    [
        (Raster((0.08, 0.0), 0.01), "without a width"),
        (Raster((0.08, 0.04), 1e-6), "more than 1000 lines"),
        (Raster((0.005, 0.04), 0.01), "shorter than their distance"),
        (Spiral(1e-6, 0.01), "spiral of 1e\\+04 turns"),
        (Spiral(0.02, 0.001), "ends before it has turned"),
        (Waypoints(((0, 0), (0, 0), (1, 0))), "points 1 and 2 are at one place"),
        (Waypoints(((0, 0), (0.01, 0), (0.01, 0.01), (0, 0.01)), 0.008), "point . is too round"),
    ],
)
def test_a_path_that_cannot_be_laid_says_why(form, message):
    wrong = form.unfit(form.own)
    assert wrong is not None
    assert re.search(message, wrong.message)
    assert wrong.hint


def test_the_radius_that_is_proposed_fits():
    points = ((0, 0), (0.01, 0), (0.012, 0.0093), (0, 0.01))
    hint = Waypoints(points, 0.008).unfit(()).hint
    radius = float(hint.split()[5]) * 1e-3
    assert Waypoints(points, radius).unfit(()) is None
    assert Waypoints(points, radius * 1.02).unfit(()) is not None
