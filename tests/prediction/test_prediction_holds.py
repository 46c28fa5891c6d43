"""Figures of the sheet where the linear press on a surface at rest is not all: held against runs.

A figure that cannot be told is left out, with its reason.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.prediction import predict
from taskspec.spec import load_text

TASK = """\
taskspec: 1
name: holds
robot: {model: panda, tool: {shape: TOOL, radius: RADIUS, length: 100 mm, mass: 300 g},
  start: {xyz: [500 mm, 0, HEIGHT]} SENSOR}
world:
  table: {shape: plane, xyz: [500 mm, 0, 300 mm], rpy: [0, TILT, 0], stiffness: STIFF,
    friction: MU MOTION}
frames: {task: {surface: table}, level: {xyz: [500 mm, 0, 300 mm]}}
frame: FRAME
law: LAW
stages:
  go: {STAGE}
  press: {axes: {z: {force: -5 N}}, time: 0.1 s}
"""
GOOD = {
    "TOOL": "sphere",
    "RADIUS": "10 mm",
    "HEIGHT": "301 mm",
    "SENSOR": "",
    "TILT": "0",
    "STIFF": "10 kN/m",
    "MU": "0",
    "MOTION": "",
    "FRAME": "level",
    "LAW": "hybrid",
    "STAGE": "axes: {z: {force: -15 N}}, time: 3 s",
}
FLAT = {"TOOL": "cylinder", "RADIUS": "20 mm", "TILT": "5 deg", "HEIGHT": "306 mm"}
SPRINGS = "stiffness: {linear: 2 kN/m, angular: 60 N*m/rad}"
HEAVING = {"MOTION": ", motion: {z: 2 mm * sin(2*pi*clock/(1 s))}"}
#: Contact stiffness is that of the file to 0.1 % (docs/conventions.md).
_CONTACT = 1e-3


def text(**changes):
    filled = TASK
    for key, value in (GOOD | changes).items():
        filled = filled.replace(key, value)
    return filled


def predicted(task, stage="go"):
    return predict(compile_unchecked(load_text(task, "t.yaml")))[stage]


def predicted_and_run(simulate, task, stage="go"):
    """What is predicted of a stage, and the run: the task is compiled once for both."""
    run = simulate(task)
    return predict(run.program)[stage], run


@pytest.mark.parametrize("law", ["hybrid", "hybrid-multipliers", "parallel", "parallel-pid"])
@pytest.mark.parametrize("frame", ["level", "task"])
def test_a_force_on_a_moving_surface(simulate, law, frame):
    """In a fixed frame the force swings; in the surface's own it stays, of a law that can tell."""
    task = text(LAW=law, FRAME=frame, **HEAVING)
    said, run = predicted_and_run(simulate, task)
    # Two periods, 1 s after the force has been reached.
    force = run.during("go", "force.z", 2.0)
    if frame == "task" and law == "parallel-pid":
        assert "its own inertia" in said.left_out["force.z"]
        return
    at = said.equilibrium["force.z"]
    assert at.steady == (frame == "task")
    # What is left of the approach after 2 s of a loop of 2 Hz is e^-12, and 0.1 % of the contact's.
    within = 2 * _CONTACT * 15.0
    assert (force.min(), force.max()) == pytest.approx((at.low, at.high), abs=within)
    assert -run.during("go", "table.gap", 2.0).min() == pytest.approx(
        said.depths["table"].depth, rel=2 * _CONTACT
    )


def test_the_closed_form_of_a_force_loop_on_a_moving_surface():
    """e = (h s^2 + d s) p_s / ((1 + p) + i/s + (h s^2 + d s)/k) at s = j w."""
    task = text(**HEAVING)
    program = compile_unchecked(load_text(task, "t.yaml"))
    stage = program.stages[0].plan
    gains = {name: by["z"].value for name, by in stage.gains.items() if "z" in by}
    h, s = stage.design_rules.plants["z"].h, 2j * math.pi
    own = h * s**2 + gains["force.damping"] * s
    e = own * 2e-3 / (1 + gains["force.proportional"] + gains["force.integral"] / s + own / 10e3)
    at = predict(program)["go"].equilibrium["force.z"]
    # A period of control late, which turns the force loop by w T.
    assert (at.high - at.low) / 2 == pytest.approx(abs(e), rel=abs(s) * 1e-3)


def test_a_surface_that_leaves_the_tool_is_not_pressed_steadily():
    deep = ", motion: {z: 20 mm * sin(2*pi*clock/(1 s))}"
    said = predicted(text(MOTION=deep))
    assert said.left_out["force.z"] == "'table' moves, and leaves the tool"
    assert "force.z" not in said.equilibrium
    assert "table" not in said.depths


def test_an_open_loop_force_on_a_moving_surface_is_left_out():
    said = predicted(text(LAW=f"{{kind: impedance, {SPRINGS}}}", **HEAVING))
    assert "moves" in said.left_out["force.z"]
    assert "force.z" not in said.equilibrium


@pytest.mark.parametrize("law", ["impedance", "impedance-natural"])
@pytest.mark.parametrize("tilt", ["5 deg", "-2 deg"])
def test_a_flat_tool_that_does_not_lie_flush(simulate, law, tilt):
    """It rests on an edge, whose depth is that of the whole contact."""
    task = text(LAW=f"{{kind: {law}, {SPRINGS}}}", **(FLAT | {"TILT": tilt}))
    said, run = predicted_and_run(simulate, task)
    for signal in ("force.z", "force.x", "torque.ry"):
        end = run.during("go", signal)[-1]
        # What springs of 2 Hz have left after 2.5 s is e^-22.
        assert end == pytest.approx(said.equilibrium[signal].value, rel=math.radians(5) ** 2)
    # The reference of a set point without a loop goes with the gap, whatever gives way.
    assert said.equilibrium["force.z"].value == pytest.approx(-15.0, rel=1e-6)
    deep = -run.during("go", "table.gap")[-1]
    assert deep == pytest.approx(said.depths["table"].depth, rel=math.radians(5) ** 2)


def test_a_flat_tool_on_a_drum(simulate):
    """Off its crown by 15 mm: the rim of 20 mm is askew to a drum of 150 mm by 13 deg at most."""
    plane = "shape: plane, xyz: [500 mm, 0, 300 mm], rpy: [0, TILT, 0]"
    drum = "shape: cylinder, radius: 150 mm, length: 600 mm, xyz: [485 mm, 0, 150 mm], "
    drum += "rpy: [90 deg, 0, 0]"
    flat = FLAT | {"TILT": "0", "HEIGHT": "301 mm"}
    task = text(LAW=f"{{kind: impedance, {SPRINGS}}}", **flat)
    task = task.replace(plane.replace("TILT", "0"), drum)
    assert "cylinder, radius: 150" in task
    said, run = predicted_and_run(simulate, task)
    askew = math.asin((15 + 20) / 150) ** 2
    for signal in ("force.z", "force.x", "torque.ry"):
        end = run.during("go", signal)[-1]
        assert end == pytest.approx(said.equilibrium[signal].value, rel=askew)
    deep = -run.during("go", "table.gap")[-1]
    assert deep == pytest.approx(said.depths["table"].depth, rel=askew)


def test_a_force_loop_presses_an_edge_as_deep_as_it_bears(simulate):
    task = text(**FLAT)
    said, run = predicted_and_run(simulate, task)
    assert said.equilibrium["force.z"].value == pytest.approx(-15.0)
    deep = -run.during("go", "table.gap")[-1]
    assert deep == pytest.approx(said.depths["table"].depth, rel=2 * _CONTACT)
    assert deep == pytest.approx(15.0 / math.cos(math.radians(5)) / 10e3, rel=_CONTACT)


def test_friction_at_an_edge_is_left_out():
    said = predicted(text(LAW=f"{{kind: impedance, {SPRINGS}}}", MU="0.3", **FLAT))
    assert "does not lie flush" in said.left_out["force.z"]


@pytest.mark.parametrize("friction", ["0", "0.3"])
def test_a_law_without_an_integral_says_nothing_under_friction(simulate, friction):
    slides = "axes: {x: {velocity: 10 mm/s}, z: {force: -15 N}}, time: 2 s"
    task = text(LAW="hybrid-reaction", MU=friction, STAGE=slides)
    said, run = predicted_and_run(simulate, task)
    force = run.during("go", "force.z")[-1]
    if friction == "0":
        assert force == pytest.approx(said.equilibrium["force.z"].value, rel=0.01)
    else:
        assert abs(force + 15.0) > 1.0
        assert "no integral" in said.left_out["force.z"]
        assert "table" not in said.depths


def test_an_arm_that_falls_rests_on_nothing():
    said = predicted(text(LAW=f"{{kind: stiffness, {SPRINGS}}}"))
    assert said.left_out["force.z"] == "nothing bears the weight of the arm, and it falls"
    assert "force.z" not in said.equilibrium
    assert "table" not in said.depths


@pytest.mark.parametrize("way", ["30 mm", "-30 mm"])
def test_a_move_begins_at_the_rate_that_is_handed_over(simulate, way):
    """It goes on along the reference that it takes over, or turns back: to a tick either way."""
    stage = "axes: {x: {velocity: 40 mm/s}}, time: 1 s"
    task = text(HEIGHT="350 mm", STAGE=stage).replace(
        "axes: {z: {force: -5 N}}, time: 0.1 s", f"axes: {{x: {{move: {way}}}}}"
    )
    said, run = predicted_and_run(simulate, task, "press")
    lasted = len(run.during("press", "t")) * 1e-3
    assert lasted == pytest.approx(said.duration.expected, abs=1.5e-3)


SENSORS = {
    "ideal": "",
    "late": ", sensor: {delay: 4 ms}",
    "wrist": ", sensor: {at: wrist, delay: 2 ms, filter: 60 Hz, rate: 500 Hz}",
}


@pytest.mark.parametrize("law", ["hybrid", "impedance"])
@pytest.mark.parametrize("guard", ["touching", "force.z < -2 N", "force.z < -2 N for 3 ms",
                                   "force.z < -2 N for 40 ms"])  # fmt: skip
@pytest.mark.parametrize("sensor", SENSORS)
def test_what_of_an_impact_comes_before_the_guard(simulate, law, guard, sensor):
    """Damping takes from the peak; what it bends of the way there is within 5 %."""
    stage = f"axes: {{z: {{velocity: -30 mm/s}}}}, until: {guard}, within: 3 s"
    task = text(LAW=law, STAGE=stage, FRAME="task", HEIGHT="320 mm", STIFF="20 kN/m",
                SENSOR=SENSORS[sensor])  # fmt: skip
    said, run = predicted_and_run(simulate, task)
    most = float(np.max(-run.during("go", "force.z")))
    assert said.impact.largest / math.e < most < 1.05 * said.impact.largest
    lasted = len(run.during("go", "t")) * 1e-3
    assert lasted == pytest.approx(said.duration.expected, abs=4e-3)
    if guard == "force.z < -2 N" and sensor == "ideal":
        assert said.impact.largest < said.impact.peak / 2
