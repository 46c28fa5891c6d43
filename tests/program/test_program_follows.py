"""`follows`, `grasp` and what the program makes of them before anything holds anything."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.compiler import compile_task
from taskspec.program.world.stiffness import GRIP
from taskspec.spec import load_text
from taskspec.text.diagnostic import Severity, SpecError

TASK = """
taskspec: 1
name: hold
robot: {model: panda, grasp: GRASP}
world:
  part: {MECHANISM}
FRAMES
stages:
  go:
    frame: FRAME
    axes: {AXES}
    time: 1 s
"""
HINGE = "mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0]"
SCREW = "mechanism: screw, xyz: [500 mm, 0, 350 mm], pitch: 20 mm/turn"
JAR = SCREW + ", handle: [60 mm, 0, 0]"
SLIDE = "mechanism: slide, xyz: [500 mm, 0, 350 mm], rpy: [0, 90 deg, 0]"


def task(mechanism, axes, frame="part", grasp="part.handle", frames=""):
    names = {"MECHANISM": mechanism, "AXES": axes, "FRAMES": frames, "FRAME": frame}
    text = TASK.replace("GRASP", grasp)
    for key in ("FRAMES", "FRAME", "MECHANISM", "AXES"):
        text = text.replace(key, names[key])
    return text


def compiled(*args, **kwargs):
    return compile_task(load_text(task(*args, **kwargs), "task.yaml"))


def codes(text):
    try:
        compile_task(load_text(text, "task.yaml"))
    except SpecError as error:
        return [d.code for d in error.diagnostics]
    return []


def test_the_start_is_at_the_handle():
    context = compiled(HINGE, "").context
    np.testing.assert_allclose(context.start_p, [0.62, 0, 0.35], atol=1e-8)
    np.testing.assert_allclose(context.start_R[:, 2], [0, 0, -1], atol=1e-8)


def test_the_start_at_the_handle_may_be_turned():
    text = task(HINGE, "").replace(
        "grasp: part.handle", "grasp: part.handle, start: {rpy: [180 deg, 20 deg, 0]}"
    )
    context = compile_task(load_text(text, "task.yaml")).context
    np.testing.assert_allclose(context.start_p, [0.62, 0, 0.35], atol=1e-8)
    assert np.degrees(np.arccos(-context.start_R[2, 2])) == pytest.approx(20)


@pytest.mark.parametrize(("x", "found"), [("620.9 mm", []), ("621.1 mm", ["TS415"])])
def test_a_given_start_has_to_be_at_the_handle(x, found):
    start = f"grasp: part.handle, start: {{xyz: [{x}, 0, 350 mm]}}"
    assert codes(task(HINGE, "").replace("grasp: part.handle", start)) == found


def test_nothing_turns_a_free_knob_on_its_axis():
    free = "mechanism: hinge, xyz: [500 mm, 0, 350 mm], knob: free"
    assert codes(task(free, "")) == ["TS416"]


def test_a_loose_body_is_held_where_it_is():
    ball = "shape: sphere, xyz: [500 mm, 0, 350 mm], radius: 30 mm, free: true, mass: 200 g"
    program = compiled(ball, "", frame="world", grasp="part")
    np.testing.assert_allclose(program.context.start_p, [0.5, 0, 0.35], atol=1e-8)
    assert program.stages[0].plan.contacts.main is None


@pytest.mark.parametrize(
    ("mechanism", "frame", "axes", "says"),
    [
        (HINGE, "part", "z: {follows: part}", "moves nothing along"),
        (HINGE, "tilted", "rz: {follows: part}", "not along the axis"),
        (HINGE, "part", "rx: {follows: part}", "not along the axis"),
        (SCREW, "part", "rz: {follows: part}", "does not go around"),
        (SLIDE, "part", "rz: {follows: part}", "does not go around"),
    ],
)
def test_what_does_not_follow_is_said(mechanism, frame, axes, says):
    frames = "frames: {tilted: {parent: part, rpy: [5 deg, 0, 0]}}"
    with pytest.raises(SpecError) as caught:
        compiled(mechanism, axes, frame=frame, frames=frames)
    (error,) = [d for d in caught.value.diagnostics if d.severity is Severity.ERROR]
    assert error.code == "TS230"
    assert says in error.message


def test_what_is_not_held_cannot_be_followed():
    text = task(JAR, "rz: {velocity: 0.5 rad/s}, z: {follows: part}").replace(
        ", grasp: part.handle", ", start: {xyz: [560 mm, 0, 350 mm]}"
    )
    assert codes(text) == ["TS230"]


def test_signals_of_what_is_not_held_are_not_known():
    text = (
        task(HINGE, "").replace(", grasp: part.handle", "").replace("frame: part", "frame: world")
    )
    guarded = text.replace("time: 1 s", "until: part.angle > 1 rad, within: {time: 1 s}".replace(
        ", within", "\n    within"))  # fmt: skip
    assert codes(guarded) == ["TS224"]


def test_a_turning_frame_keeps_its_control_point():
    frames = "frames: {grip: {parent: part.handle, point: origin}}"
    assert codes(task(HINGE, "", frame="grip", frames=frames)) == ["TS231"]


def test_gains_are_designed_for_the_grip():
    """Stiff where the handle is held, none along the way that it leaves open."""
    axes = "x: {force: 0}, y: {force: 0}, z: {force: 0}, rx: {torque: 0}"
    program = compiled(HINGE + ", knob: free", axes, frame="part.handle")
    stage = program.stages[0]
    assert stage.plan.environment.stiffness == GRIP.stiffness
    assert stage.plan.contacts.held == "part"
    damping = {a: g.value for a, g in stage.plan.gains["force.damping"].items()}
    k = stage.plan.environment.by_axis
    linear, angular = GRIP.stiffness, GRIP.angular_stiffness
    assert k == {"x": linear, "y": 0.0, "z": linear, "rx": angular, "ry": angular, "rz": 0.0}
    assert damping["y"] == 0.0
    assert min(damping["x"], damping["z"], damping["rx"]) > 0.0
    assert not program.findings


def test_at_its_hinge_a_door_gives_way_to_a_moment_alone():
    """A moment across the axis is held at the handle's distance: k r^2 and the grip's own."""
    frames = "frames: {pivot: {parent: part, point: origin}}"
    program = compiled(HINGE, "rz: {velocity: 0.1 rad/s}", frame="pivot", frames=frames)
    stage = program.stages[0]
    k = stage.plan.environment.by_axis
    leaned = GRIP.angular_stiffness + GRIP.stiffness * 0.12**2
    assert k["rz"] == 0.0
    assert (k["rx"], k["ry"]) == (pytest.approx(GRIP.angular_stiffness), pytest.approx(leaned))


CRANK = """
taskspec: 1
name: crank
robot: {model: panda, grasp: crank.handle}
world:
  crank: {mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0], knob: free}
frame: crank.handle
stages:
  first:
    axes: {y: {velocity: 250 mm/s}, rz: {hold: world}}
    until: crank.angle > 0.9 turn
    within: {time: 5 s}
  rest:
    frame: world
    axes: {}
    time: 0.5 s
  second:
    axes: {y: {velocity: 250 mm/s}, rz: {hold: world}}
    until: crank.angle > 1.8 turn
    within: {time: 5 s}
  back:
    axes: {y: {velocity: -250 mm/s}, rz: {hold: world}}
    until: crank.angle < 1.2 turn
    within: {time: 5 s}
"""


def test_the_count_of_turns_survives_stages(simulate):
    """Guards see the true angle to what the grip gives: some newtons over k r = 6 kN/rad."""
    run = simulate(CRANK)
    assert run.outcome.status == "done"
    for stage, angle in (("first", 0.9), ("second", 1.8), ("back", 1.2)):
        # The tick that ends a stage is the first of the next; at 2.1 rad/s it adds 2 mrad.
        last = run.during(stage, "crank.angle")[-1]
        assert last == pytest.approx(angle * 2 * np.pi, abs=5e-3)
    assert run.during("second", "position.y")[0] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.xdist_group("shipped")
def test_the_way_down_a_thread_keeps_step_with_the_turn_that_is_commanded(simulate):
    """Both references come from one: z - lead rz stays what it was at the stage's start."""
    run = simulate("screw")
    stage = run.program.stages[0]
    assert (stage.plan.couplings["z"].leader, stage.plan.couplings["z"].ratio) == (
        "rz",
        pytest.approx(0.004 / (2 * np.pi)),
    )
    z = run.during("screw_down", "position.z.ref")
    rz = run.during("screw_down", "position.rz.ref")
    whole = np.unwrap(rz)
    # At half a turn a rotation vector has no direction.
    known = np.abs(rz) < 3.0
    step = z - z[0] - 0.004 / (2 * np.pi) * (whole - whole[0])
    np.testing.assert_allclose(step[known], 0.0, atol=1e-9)
    rates = [run.during("screw_down", f"velocity.{a}.ref") for a in ("z", "rz")]
    np.testing.assert_allclose(rates[0], 0.004 / (2 * np.pi) * rates[1], atol=1e-12)


def test_a_door_is_followed_by_its_angle_in_a_frame_at_rest(simulate):
    """The measured angle leads: its rate is fed forward, and its acceleration is the lag.

    Where the speed is blended in over 0.2 s, that is at most 1.9 * 0.35 rad/s / 0.2 s = 3.3 rad/s^2
    over K_P = 987, 3.3 mrad; later nothing.
    """
    text = task(HINGE + ", inertia: 0.1 kg*m^2", "", frame="part").replace(
        "axes: {}",
        "axes: {x: {position: 120 mm * cos(0.35 rad/s * t)}, y: {position: 120 mm * "
        "sin(0.35 rad/s * t)}, rz: {follows: part}}",
    )
    run = simulate(text)
    assert run.outcome.status == "done"
    error = np.abs(run.during("go", "error.rz"))
    assert error.max() < 4e-3
    assert error[600:].max() < 2e-4
    # It starts from rest, and so is 0.1 s behind after its 1 s.
    assert run["part.angle"][-1] == pytest.approx(0.9 * 0.35, abs=5e-3)
