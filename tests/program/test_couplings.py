"""`follows` an expression of other axes: its reference with rates, hand-over, order, messages."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.compiler import compile_task
from taskspec.spec import load_text
from taskspec.text.diagnostic import Diagnostic, SpecError

TASK = """
taskspec: 1
name: couplings
robot: {model: panda, start: {xyz: [500 mm, 0, 350 mm]}}
frames:
  here: {parent: world, xyz: [500 mm, 0, 350 mm]}
  held: {parent: tool, rpy: [180 deg, 0, 0]}
frame: FRAME
params: {wave: 10 mm}
stages:
STAGES
"""
#: a = 20 mm (40 mm/s / 10 mm)^2 = 0.32 m/s^2; left out of the feed-forward, it would cost the
#: loop of 5 Hz an error of a / (2 pi 5 Hz)^2 = 324 um.
WAVE = "20 mm * sin(x/wave)"


def task(*stages: str, frame: str = "here") -> str:
    body = "\n".join(f"  s{i}: {text}" for i, text in enumerate(stages))
    return TASK.replace("FRAME", frame).replace("STAGES", body)


def findings(text: str) -> tuple[Diagnostic, ...]:
    try:
        return compile_task(load_text(text, "task.yaml")).findings
    except SpecError as error:
        return error.diagnostics


def rate_of(values: np.ndarray, period: float = 1e-3) -> np.ndarray:
    """Central difference, whose own error is r''' T^2 / 6."""
    return (values[2:] - values[:-2]) / (2 * period)


@pytest.mark.parametrize(
    ("axis", "follows", "f"),
    [
        ("y", "2 * x", lambda x: 2 * x),
        ("y", WAVE, lambda x: 0.02 * np.sin(x / 0.01)),
        ("z", "x^2 / (100 mm) - 3 mm", lambda x: x**2 / 0.1 - 0.003),
        ("rz", "5 rad/m * x", lambda x: 5 * x),
    ],
)
def test_an_axis_is_where_its_leader_puts_it(simulate, axis, follows, f):
    """r and r' after what the stage start blends in; r' is the derivative of r."""
    stage = f"{{axes: {{x: {{velocity: 40 mm/s}}, {axis}: {{follows: {follows}}}}}, time: 2 s}}"
    run = simulate(task(stage))
    assert run.outcome.status == "done"
    late = slice(1200, None)
    x, r = run["position.x.ref"][late], run[f"position.{axis}.ref"][late]
    np.testing.assert_allclose(r, f(x), atol=1e-9)
    rate = run[f"velocity.{axis}.ref"][late][1:-1]
    # r''' of the wave is 20 mm (4/s)^3 = 1.3 m/s^3.
    np.testing.assert_allclose(rate, rate_of(r), atol=1e-6)
    assert np.ptp(r) > 5e-3


@pytest.mark.parametrize("frame", ["here", "held"])
def test_the_acceleration_of_a_bent_coupling_is_fed_forward(simulate, frame):
    """Leader integrated by a velocity, in a frame at rest and in one that the tool carries.

    What is left, measured as 10 um, is of the loop's samples: a twentieth of 324 um bounds it.
    """
    stage = f"{{axes: {{x: {{velocity: 40 mm/s}}, y: {{follows: {WAVE}}}}}, time: 2 s}}"
    run = simulate(task(stage, frame=frame))
    assert np.abs(run["error.y"][1200:]).max() < 324e-6 / 20


def test_two_turns_of_one_leader_make_one_rotation(simulate):
    """The rate of the rotation vector is not the angular velocity; the loop sees the latter."""
    axes = "x: {velocity: 40 mm/s}, rx: {follows: 4 rad/m * x}, rz: {follows: 8 rad/m * x + 2 * rx}"
    run = simulate(task(f"{{axes: {{{axes}}}, time: 2 s}}"))
    errors = np.abs(np.stack([run[f"error.{a}"][1200:] for a in ("rx", "rz")]))
    assert errors.max() < 1e-5
    assert run["position.rz.ref"][-1] == pytest.approx(16 * run["position.x.ref"][-1], abs=1e-6)


def test_a_chain_of_followers_is_handed_over_without_a_step(simulate):
    """Each starts from where its leader is handed over, whatever the order of the axes.

    The coupling of the second stage is 60 mm away from where the first one ends: y is taken
    there no faster than by a move, 50 mm/s, beside what x itself makes of it.
    """
    follow = "z: {follows: 0.5 * y}, y: {follows: KEPT}"
    going = f"x: {{velocity: 20 mm/s}}, {follow}"
    same = f"{{axes: {{{going.replace('KEPT', 'x')}}}, time: 1 s}}"
    other = f"{{axes: {{{going.replace('KEPT', 'x + 60 mm')}}}, time: 4 s}}"
    run = simulate(task(same, same, other))
    assert run.outcome.status == "done"
    for axis in ("y", "z"):
        steps = np.diff(run[f"position.{axis}.ref"])
        # The reference is measured position plus error: double rounding alone is 1e-15.
        assert np.abs(steps).max() < (0.05 + 0.021) * 1e-3
    x, y, z = (run.during("s1", f"position.{a}.ref") for a in "xyz")
    # The speed of x passes from stage to stage through its blending, and takes y and z along.
    np.testing.assert_allclose(y, x, atol=1e-9)
    np.testing.assert_allclose(z, 0.5 * x, atol=1e-9)
    assert run["position.y.ref"][-1] == pytest.approx(run["position.x.ref"][-1] + 0.06, abs=1e-9)


PRESSED = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 302 mm]}}
world:
  table:
    {shape: plane, xyz: [500 mm, 0, 300 mm], rpy: [0, 10 deg, 0], stiffness: 20 kN/m, friction: 0}
frames: {here: {parent: world, xyz: [500 mm, 0, 300 mm]}}
frame: here
stages:
  approach: {axes: {z: {velocity: -10 mm/s}}, until: force.z < -2 N, within: {time: 2 s}}
  follow:
    axes:
      x: {velocity: 20 mm/s}
      z: {force: -8 N}
      y: {follows: 2 * z}
      rx: {follows: 3 rad/m * z}
    time: 2 s
"""


def test_a_leader_under_force_is_followed_where_it_is_measured(simulate):
    """z falls with the table by tan 10 deg; y and rx go by what is measured, with its rate."""
    run = simulate(PRESSED)
    assert run.outcome.status == "done"
    z = run.during("follow", "position.z")[1200:]
    rate = run.during("follow", "velocity.z")[1200:]
    for axis, ratio in (("y", 2.0), ("rx", 3.0)):
        r = run.during("follow", f"position.{axis}.ref")[1200:]
        np.testing.assert_allclose(r, ratio * z, atol=1e-12)
        v = run.during("follow", f"velocity.{axis}.ref")[1200:]
        np.testing.assert_allclose(v, ratio * rate, atol=1e-12)
        assert np.abs(run.during("follow", f"error.{axis}")[1200:]).max() < 1e-4
    assert np.ptp(z) > 2e-3


@pytest.mark.parametrize(
    ("axes", "code", "says"),
    [
        ("x: {follows: y}, y: {follows: 2*x}", "TS260", "'x' follows 'y' follows 'x'"),
        (
            "x: {follows: z}, y: {follows: x}, z: {follows: 0.5*y}",
            "TS260",
            "'x' follows 'z' follows 'y' follows 'x'",
        ),
        ("y: {follows: y + 3 mm}", "TS260", "'y' follows itself"),
        ("y: {follows: 2 * wave}", "TS261", "names no other axis"),
        ("x: {move: 20 mm}, rz: {follows: 2 * x}", "TS112", "an angle"),
        ("x: {move: 20 mm}, y: {follows: 2 * position.x}", "TS116", "'position.x'"),
        ("x: {move: 20 mm}, y: {follows: x + 5 mm * sin(t * 1 Hz)}", "TS116", "'t'"),
        ("y: {follows: belt}", "TS123", "'belt' is no mechanism"),
    ],
)
def test_what_cannot_be_followed_is_refused(axes, code, says):
    found = findings(task(f"{{axes: {{{axes}}}, time: 1 s}}"))
    errors = [d for d in found if d.severity == "error"]
    assert [d.code for d in errors] == [code]
    assert says in errors[0].message


def test_an_axis_that_a_planar_arm_lacks_leads_nothing():
    text = """
taskspec: 1
robot: {model: planar3}
stages: {go: {axes: {x: {follows: z}}, time: 1 s}}
"""
    (error,) = [d for d in findings(text) if d.severity == "error"]
    assert error.code == "TS262"
