"""Moves, timings, splines, blending and tables."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from taskspec.geometry.axis import Axis
from taskspec.motion import blend, profile
from taskspec.motion.path import PathShape
from taskspec.motion.paths import Arc, Line, Lissajous, TableFile, To
from taskspec.motion.table import TableError, read_table
from taskspec.text.confines import confines

UNITS = {"mm": 1e-3, "m": 1.0, "s": 1.0, "deg": np.pi / 180}


def unit(text, _column):
    if text not in UNITS:
        raise ValueError(f"no unit {text!r}")
    return UNITS[text]


def derivatives(cubic, t):
    start, c0, c1, c2, c3 = cubic.segment(t)
    s = t - start
    return (
        c0 + s * (c1 + s * (c2 + s * c3)),
        c1 + s * (2 * c2 + s * 3 * c3),
        2 * c2 + 6 * c3 * s,
        6 * c3,
    )


@pytest.mark.parametrize(
    ("start", "velocity", "target"),
    [(0, 0, 0.05), (0.1, 0.03, -0.2), (0, 0, 1e-4), (0, -0.2, 0.05)],
)
def test_a_move_keeps_its_limits_and_arrives(start, velocity, target):
    speed = 0.05
    cubic = profile.move(start, velocity, target, speed)
    times = np.linspace(0, cubic.end, 4001)
    position, rate, acceleration, jerk = np.array([derivatives(cubic, t) for t in times]).T
    assert position[0] == pytest.approx(start)
    assert rate[0] == pytest.approx(velocity)
    assert position[-1] == pytest.approx(target, abs=1e-9)
    assert rate[-1] == pytest.approx(0, abs=1e-9)
    assert np.max(np.abs(rate)) <= max(speed, abs(velocity)) * (1 + 1e-9)
    assert np.max(np.abs(acceleration)) <= 2 * speed / 0.2 * 1.001 * (1 + 1e-6)
    assert np.max(np.abs(jerk)) <= 4 * speed / 0.04 * (1 + 1e-6)
    # Position, velocity and acceleration have no jumps at the knots.
    for knot in cubic.knots[1:-1]:
        before, after = derivatives(cubic, knot - 1e-12), derivatives(cubic, knot)
        np.testing.assert_allclose(before[:3], after[:3], atol=1e-8)


def test_moves_whose_length_fits_the_limits_exactly():
    """Distances of k speed x rise are where a phase of the profile has no length."""
    rng = np.random.default_rng(3)
    for _ in range(500):
        speed = round(10 ** rng.uniform(-3, 0.5), 3) or 1e-3
        distance = speed * 0.2 * rng.choice([-2, -1, -0.5, 0.25, 0.5, 1, 2])
        assert profile.move(0, 0, distance, speed).knots[-2] > 0
        assert profile.move(0.3, 0, 0.3 + distance, speed)(99.0) == pytest.approx(0.3 + distance)


def test_moves_from_any_rate_keep_their_limits_and_arrive():
    """Rates to both sides and beyond the speed, ways that need to turn back or to brake first."""
    rng = np.random.default_rng(11)
    for _ in range(300):
        speed, rise = 10 ** rng.uniform(-3, 0.5), rng.uniform(0.05, 0.4)
        velocity = speed * rng.uniform(-3, 3)
        way = speed * rise * rng.choice([-1, 1]) * 10 ** rng.uniform(-4, 2)
        cubic = profile.move(0.3, velocity, 0.3 + way, speed, rise)
        times = np.linspace(0, cubic.rests, 301)
        position, rate, acceleration, jerk = np.array([derivatives(cubic, t) for t in times]).T
        fastest = max(speed, abs(velocity))
        assert np.max(np.abs(rate)) <= fastest * (1 + 1e-9)
        assert np.max(np.abs(acceleration)) <= 2 * speed / rise * (1 + 1e-9)
        assert np.max(np.abs(jerk)) <= 4 * speed / rise**2 * (1 + 1e-9)
        assert position[0] == 0.3
        assert rate[0] == velocity
        # At rest where it ends, to the rounding of the places and of the way in between.
        before = derivatives(cubic, np.nextafter(float(cubic.rests), 0.0))
        scale = fastest * max(float(cubic.rests), rise) + 0.3 + abs(way)
        assert before[0] == pytest.approx(0.3 + way, abs=1e-13 * scale)
        assert before[1] == pytest.approx(0, abs=1e-13 * fastest)
        for knot in cubic.knots[1:-2]:
            left, right = derivatives(cubic, np.nextafter(knot, 0.0)), derivatives(cubic, knot)
            size = np.array([scale, fastest, 2 * speed / rise])
            assert np.all(np.abs(np.subtract(left, right))[:3] <= 1e-9 * size)


def test_moves_are_the_same_of_numbers_and_of_expressions():
    given = [ca.SX.sym(name) for name in ("start", "velocity")]
    cubic = profile.move(given[0], given[1], given[0] + 0.2, 0.05)
    move = ca.Function("move", given, [cubic.knots, cubic.coefficients, cubic.segment_at_start()])
    for start, velocity in ((0.0, 0.0), (0.1, 0.03), (-0.2, -0.07), (0.4, 0.09)):
        knots, coefficients, first = (np.array(part) for part in move(start, velocity))
        same = profile.move(start, velocity, start + 0.2, 0.05)
        np.testing.assert_allclose(knots.ravel(), same.knots, rtol=1e-14)
        np.testing.assert_allclose(coefficients, same.coefficients, atol=1e-15, rtol=1e-13)
        np.testing.assert_allclose(first.ravel(), same.segment(0.0), atol=1e-15, rtol=1e-13)


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_there_is_no_move_of_numbers_that_are_not_finite(number):
    with pytest.raises(ValueError, match="no move from"):
        profile.move(0.0, number, 1.0, 0.1)
    with pytest.raises(ValueError, match="no move from"):
        profile.move(0.0, 0.0, 1.0, 0.0)


def test_a_long_move_reaches_its_speed_in_a_fifth_of_a_second():
    cubic = profile.move(0, 0, 1.0, 0.1)
    assert derivatives(cubic, 0.2)[1] == pytest.approx(0.1)
    assert cubic.knots[-2] == pytest.approx(1.0 / 0.1 + 0.2)


@pytest.mark.parametrize("time", [0.1, 0.3, 4.0])
def test_a_timed_path_takes_its_time(time):
    along = profile.timing(0.3, speed=None, time=time)
    assert along.knots[-2] == pytest.approx(time)
    assert along(time) == pytest.approx(1)
    assert along(time / 2) == pytest.approx(0.5)


def test_blending_shapes_begin_and_end_as_they_must():
    t = ca.SX.sym("t")
    half = blend.BLEND_TIME / 2
    for shape, first, last in (
        (lambda t: blend.offset_shape(t / blend.BLEND_TIME), (1, 0, 0), (0, 0, 0)),
        (blend.run_out, (-half, 1, 0), (0, 0, 0)),
        (blend.from_rest, (0, 0, 0), (half, 1, 0)),
    ):
        value = shape(t)
        rate = ca.gradient(value, t)
        curve = ca.Function("f", [t], [value, rate, ca.gradient(rate, t)])
        np.testing.assert_allclose([float(x) for x in curve(0)], first, atol=1e-12)
        end = blend.BLEND_TIME * (1 - 1e-13)
        np.testing.assert_allclose([float(x) for x in curve(end)], last, atol=1e-9)
        # Expressions and numbers are one function.
        for time in (0.0, 0.03, 0.11, 0.2, 1.7):
            assert shape(time) == pytest.approx(float(curve(time)[0]), abs=1e-15)


def test_what_starts_from_rest_is_never_faster_than_time_and_never_goes_back():
    times = np.linspace(-0.1, 0.5, 6001)
    passed = np.array([blend.from_rest(t) for t in times])
    rates = np.diff(passed) / np.diff(times)
    assert rates.min() >= -1e-12
    assert rates.max() <= 1 + 1e-9
    assert blend.from_rest(7.0) == pytest.approx(6.9, abs=1e-14)
    left = np.array([blend.run_out(t) for t in times[times >= 0]])
    assert np.diff(left).min() >= -1e-15


def test_a_large_offset_is_blended_no_faster_than_a_move():
    assert blend.blend_time(1e-4, 0.05) == 0.2
    # A large offset is blended at no more than the speed of a default move.
    offset, speed = 0.06, 0.05
    time = blend.blend_time(offset, speed)
    rates = np.gradient([float(blend.offset_shape(ca.DM(x))) for x in np.linspace(0, 1, 2001)])
    assert np.max(np.abs(rates)) * 2000 * offset / time == pytest.approx(speed, rel=1e-3)


def test_a_table_is_splined_like_scipys(tmp_path):
    file = tmp_path / "p.csv"
    file.write_text("# a comment\nx [mm], y [mm]\n0, 0\n30, 10\n60, -10\n90, 0\n")
    table = read_table(file, unit, confines(file.parent))
    assert table.length == pytest.approx(np.hypot(30, 10) * 2e-3 + np.hypot(30, 20) * 1e-3)
    path = PathShape(TableFile("p.csv", table), (Axis.X, Axis.Y), speed=0.05).ready()
    plan = path.plan({Axis.X: 0.0, Axis.Y: 0.0})
    spline = CubicSpline(table.argument(), table.points["y"], bc_type="natural")
    for s in np.linspace(0, 1, 57):
        assert plan.splines[Axis.Y](s) == pytest.approx(float(spline(s)), abs=1e-15)
    # The knots of the plan are the times at which the points are passed.
    s = [plan.timing(t) for t in plan.knots()]
    for argument in table.argument()[1:-1]:
        assert np.min(np.abs(np.array(s) - argument)) < 1e-9


def test_a_timed_table_ends_in_its_own_time(tmp_path):
    file = tmp_path / "p.csv"
    file.write_text("t [s],x [mm]\n0.5,0\n1.0,30\n2.5,60\n")
    table = read_table(file, unit, confines(file.parent))
    plan = PathShape(TableFile("p.csv", table), (Axis.X,)).ready().plan({})
    assert plan.duration == 2.0
    # It begins at 60 mm/s, so it starts from rest: 0.1 s behind, of which it loses none in the end.
    rate = 2.0 / 1.9
    assert plan.timing(0.0) == 0.5
    assert plan.timing(0.2) == pytest.approx(0.5 + rate * 0.1)
    assert plan.timing(1.0) == pytest.approx(0.5 + rate * 0.9)
    assert plan.splines[Axis.X](plan.timing(2.0)) == pytest.approx(0.06)
    assert plan.splines[Axis.X](plan.timing(9.0)) == pytest.approx(0.06)
    times = np.linspace(0, 2, 4001)
    rates = np.diff([plan.timing(t) for t in times]) / np.diff(times)
    assert rates.max() == pytest.approx(rate, rel=1e-6)


def test_a_timed_table_that_begins_at_rest_keeps_its_own_time(tmp_path):
    file = tmp_path / "p.csv"
    file.write_text("t [s],x [mm]\n0.5,0\n1.0,0\n2.5,60\n")
    table = read_table(file, unit, confines(file.parent))
    plan = PathShape(TableFile("p.csv", table), (Axis.X,)).ready().plan({})
    assert [plan.timing(t) for t in (0.0, 0.5, 2.0, 9.0)] == [0.5, 1.0, 2.5, 2.5]


@pytest.mark.parametrize(
    ("text", "message", "line"),
    [
        ("x [mm]\n1\n", "at least two points", 0),
        ("x [mm],q [mm]\n1,2\n2,3\n", "column 'q' is none of", 1),
        ("x,y [mm]\n1,2\n2,3\n", "column 'x' has no unit", 1),
        ("x [mm],x [mm]\n1,2\n2,3\n", "twice", 1),
        ("x [furlong]\n1\n2\n", "no unit 'furlong'", 1),
        ("x [mm],y [mm]\n1,2\n2\n", "1 cells where the header has 2", 3),
        ("x [mm]\n1\nfast\n", "not a number", 3),
        ("x [mm]\n1\nnan\n", "not finite", 3),
        ("t [s]\n1\n2\n", "no column of coordinates", 1),
        ("t [s],x [mm]\n0,1\n2,2\n2,3\n", "t must increase", 4),
        ("x [mm]\n1\n2\n2\n", "a point repeats", 4),
    ],
)
def test_a_spoiled_table_says_what_and_where(tmp_path, text, message, line):
    file = tmp_path / "p.csv"
    file.write_text(text)
    with pytest.raises(TableError, match=message) as caught:
        read_table(file, unit, confines(file.parent))
    assert caught.value.line == line


def test_lengths_of_paths():
    start = {Axis.X: 0.1, Axis.Y: 0.0}
    both = (Axis.X, Axis.Y)
    assert PathShape(To((0.4, 0.4)), both).length(start) == pytest.approx(0.5)
    assert PathShape(Line((-0.2,)), (Axis.X,)).length(start) == pytest.approx(0.2)
    arc = PathShape(Arc((0.0, 0.0), -0.5), both)
    assert arc.length(start) == pytest.approx(0.1 * np.pi)
    circle = PathShape(Lissajous((0.1,), (2.0,)), (Axis.X,))
    assert circle.length(start) == pytest.approx(8 * 0.1, rel=1e-6)
