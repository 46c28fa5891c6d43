"""How references start: from rest, continuing what is handed over, and as it is predicted."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.examination import check_task
from taskspec.motion import blend
from taskspec.spec import load_text

TEXT = """\
taskspec: 1
name: starts
robot: {model: planar2, start: {xyz: [400 mm, 100 mm, 0]}}
EXTRA
stages:
STAGES
"""
#: 2 pi/s at 30 mm: 188 mm/s; a reference of positions is worked out to rounding.
FAST = 0.03 * 2 * math.pi
CIRCLE = """\
  round:
    axes:
      x: {position: 400 mm + 30 mm*sin(2*pi*t/(1 s))}
      y: {position: 130 mm - 30 mm*cos(2*pi*t/(1 s))}
    time: 2 s
"""


def text(stages: str, extra: str = "") -> str:
    return TEXT.replace("STAGES", stages).replace("EXTRA", extra)


def speed(run) -> np.ndarray:
    return np.hypot(run["velocity.x.ref"], run["velocity.y.ref"])


def test_an_expression_starts_from_rest_on_its_own_path(simulate):
    """The circle itself, never faster than its own 188 mm/s; a blend of its axes went at 151 %."""
    run = simulate(text(CIRCLE))
    t, x, y = (run[name] for name in ("t", "position.x.ref", "position.y.ref"))
    assert np.max(np.abs(np.hypot(x - 0.4, y - 0.13) - 0.03)) < 1e-9
    assert speed(run)[0] < 1e-9
    assert speed(run).max() <= FAST * (1 + 1e-9)
    late = t > blend.BLEND_TIME
    np.testing.assert_allclose(x[late], 0.4 + 0.03 * np.sin(2 * np.pi * (t[late] - 0.1)), atol=1e-9)
    assert run.outcome.clock == pytest.approx(2.0)


def test_an_expression_waits_until_its_start_is_reached(simulate):
    """20 mm off: gone to at the 50 mm/s of a default move, then from rest; neither is exceeded."""
    run = simulate(text(CIRCLE.replace("130 mm", "150 mm").replace("time: 2 s", "time: 3 s")))
    wait = blend.blend_time(0.02, 0.05)
    t, x, y = (run[name] for name in ("t", "position.x.ref", "position.y.ref"))
    before = t < wait
    assert wait == pytest.approx(0.75)
    assert np.max(np.abs(x[before] - 0.4)) < 1e-9
    assert speed(run)[before].max() == pytest.approx(0.05, rel=1e-4)
    after = t > wait
    assert np.max(np.abs(np.hypot(x - 0.4, y - 0.15)[after] - 0.03)) < 1e-9
    assert speed(run).max() <= FAST * (1 + 1e-9)


@pytest.mark.parametrize(
    "other",
    ["ry: {torque: 0.1 N*m * sin(t/(1 s))}", "y: {velocity: 10 mm/s * cos(2*pi*t/(1 s))}"],
)
def test_where_something_else_goes_by_the_same_time_the_phase_is_kept(other):
    axis = "x: {position: 400 mm + 30 mm*sin(2*pi*t/(1 s))}"
    robot = "planar3" if "ry" in other else "planar2"
    file = text(f"  go: {{axes: {{{axis}, {other.replace('ry', 'rz')}}}, time: 2 s}}\n")
    plan = compile_unchecked(load_text(file.replace("planar2", robot), "s.yaml")).stages[0].plan
    assert plan.from_rest == frozenset()


def test_what_uses_the_clock_keeps_its_phase_and_is_caught_up_with(simulate):
    """Faster than itself by at most 1.875 T/2 over `CATCH_UP`, 19 %; it was by 51 %."""
    run = simulate(
        text("""\
  wait: {time: 1 s}
  go: {axes: {x: {position: 400 mm + 30 mm*sin(2*pi*clock/(1 s))}}, time: 2 s}
""")
    )
    clock, x, rate = (
        run.during("go", name) for name in ("clock", "position.x.ref", "velocity.x.ref")
    )
    late = clock > 1.0 + blend.CATCH_UP
    phase = 2 * np.pi * clock
    np.testing.assert_allclose(x[late], 0.4 + 0.03 * np.sin(phase[late]), atol=1e-9)
    assert abs(rate[0]) < 1e-9
    assert np.abs(rate).max() <= FAST * (1 + 1.875 * 0.1 / blend.CATCH_UP)


def test_a_velocity_rises_in_proportion(simulate):
    """v S(t/T), also of one that turns back while it is blended; the integral is its way.

    Taken step by step, a step errs by h^3/6 of v's curvature, (2 pi 5 Hz)^2 20 mm/s: 3e-6 mm in
    each of the 200 steps of the blend at the most.
    """
    v = "20 mm/s*cos(2*pi*t*5/(1 s))"
    run = simulate(text(f"  go: {{axes: {{x: {{velocity: {v}}}}}, time: 1 s}}\n"))
    t, rate = run["t"], run["velocity.x.ref"]
    rises = np.array([blend.ramp_shape(s / blend.BLEND_TIME) for s in t])
    np.testing.assert_allclose(rate, 0.02 * np.cos(10 * np.pi * t) * rises, atol=1e-12)
    fine = np.linspace(0, t[-1], 100 * (len(t) - 1) + 1)
    ramp = np.array([blend.ramp_shape(s / blend.BLEND_TIME) for s in fine])
    exact = np.trapezoid(0.02 * np.cos(10 * np.pi * fine) * ramp, fine)
    assert run["position.x.ref"][-1] - run["position.x.ref"][0] == pytest.approx(exact, abs=1e-8)


APPROACH = """\
  go: {axes: {x: {velocity: -40 mm/s}}, until: position.x < 380 mm, within: {time: 3 s}}
"""


@pytest.mark.parametrize("way", ["20 mm", "-20 mm", "-8 mm"])
def test_a_move_goes_on_from_the_rate_that_is_carried(simulate, way):
    """Its course is planned from that rate too: from rest it would be 20 ms off or more.

    Half a tick of rounding, and the one in which the end is looked at.
    """
    file = text(APPROACH + f"  back: {{axes: {{x: {{move: {way}}}}}}}\n")
    run = simulate(file)
    program = compile_unchecked(load_text(file, "s.yaml"))
    planned = program.plan.follow("back").nominal.course.duration
    rate = run.during("back", "velocity.x.ref")
    assert rate[0] == pytest.approx(-0.04, abs=1e-9)
    lasted = len(rate) * 1e-3
    assert planned == pytest.approx(lasted, abs=1.5e-3)
    still = program.stages[1].plan.plans["x"].mode.duration(0.0)
    assert abs(still - lasted) > 0.02


@pytest.mark.parametrize(("limit", "codes"), [(189, set()), (188, {"TS420"})])
def test_the_fastest_instant_is_held_against_the_limit_on_speed(limit, codes):
    """The circle goes at 188.5 mm/s, started from rest: below the limit, or beyond it."""
    file = text(CIRCLE, f"limits: {{speed: {limit} mm/s}}")
    found = {d.code for d in check_task(load_text(file, "s.yaml"))}
    assert found == codes


@pytest.mark.parametrize(
    "axes",
    [
        "x: {position: 400 mm + 30 mm*sin(2*pi*t/(1 s))}, y: {move: 20 mm}",
        "x: {position: 410 mm - 30 mm*sin(2*pi*t/(1 s))}",
        "x: {velocity: 20 mm/s}, y: {velocity: -5 mm/s}",
        "x: {position: 380 mm - 30 mm*sin(2*pi*t/(1 s))}, y: {velocity: 15 mm/s}",
    ],
)
def test_what_is_predicted_is_what_the_reference_does(simulate, axes):
    """One function owns the start of a reference: the way of each axis, tick by tick."""
    before = "  go: {axes: {x: {velocity: -40 mm/s}}, time: 0.5 s}\n"
    file = text(f"{before}  on: {{axes: {{{axes}}}, time: 2 s}}\n")
    program = compile_unchecked(load_text(file, "s.yaml"))
    course = program.plan.follow("on").nominal.course
    run = simulate(file)
    t = run.during("on", "t")
    for axis in course.displacements:
        ref = run.during("on", f"position.{axis}.ref")
        predicted = np.array([course.displacements[axis](s) for s in t])
        np.testing.assert_allclose(predicted, ref - ref[0], atol=1e-6)
