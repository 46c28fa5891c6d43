"""Cases from the field: each is announced with the cause that it has, or not at all."""

from __future__ import annotations

import pytest
from trials import checked, found, place_of, serious

from taskspec.spec import load_text
from taskspec.text.diagnostic import Severity, SpecError

BIASED = """\
taskspec: 1
robot:
  model: ur5e
  tool: {length: 120 mm, mass: 1 kg}
  start: {xyz: [450 mm, 100 mm, 320 mm]}
  sensor: {at: wrist, bias: [0, 0, 4 N, 0, 0, 0]}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
frame: table
limits: {force: 60 N}
stages:
  approach:
    axes: {z: {velocity: -20 mm/s}}
    until: force.z < -GUARD for 10 ms
    within: {time: 5 s}
  press: {axes: {z: {force: -10 N}}, time: 3 s}
  leave: {axes: {z: {move: 30 mm}}}
expect:
  - press.force.z within -10 N +- 1 N for 60 %
"""
INERTIA = """\
taskspec: 1
robot:
  model: ur5e
  tool: {length: 150 mm, mass: MASS}
  start: {xyz: [450 mm, 100 mm, 500 mm]}
  sensor: {at: wrist}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
frame: world
limits: {force: 100 N}
stages:
  down:
    axes: {z: {move: -150 mm, speed: 400 mm/s}}
    fail_if: norm(force) > MOST
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -12 N for 10 ms, within: {time: 6 s}}
  press: {axes: {z: {force: -20 N}}, time: 2 s}
expect:
  - press.force.z within -20 N +- 1 N for 60 %
"""
BOWL = """\
taskspec: 1
name: bowl
robot: {model: panda, start: {xyz: [500 mm, 0, 300 mm]}}
world: {bowl: {SHAPE, radius: 150 mm, xyz: [500 mm, 0, 300 mm], stiffness: 20 kN/m}}
frames: {task: {surface: bowl}}
frame: task
limits: {force: 60 N}
stages:
  approach:
    axes: {z: {velocity: -20 mm/s}}
    until: force.z < -3 N for 10 ms
    within: {time: 10 s}
  wipe: {axes: {z: {force: -10 N}, x: {velocity: 30 mm/s}}, time: 2 s}
expect:
  - wipe.force.z within -10 N +- 2 N for 90 %
  - last(wipe.force.z) within -10 N +- 10 mN
  - last(wipe.velocity.ry) within -0.2 rad/s +- 1 mrad/s
  - last(approach.bowl.gap) within -0.2 mm +- 0.15 mm
"""
CAP = """\
taskspec: 1
robot: {model: panda, grasp: cap.handle}
world:
  cap:
    {mechanism: screw, xyz: [500 mm, 0, 300 mm], pitch: 1 mm/turn, friction: 0.2 N*m,
     stop: -300 .. 400 deg}
frame: cap
limits: {force: 40 N, torque: 3 N*m}
stages:
  drive:
    axes:
      rz: {velocity: -60 deg/s}
      z: {force: -5 N}
    until: abs(torque.rz) > 1.5 N*m
    within: {time: 8 s}
expect:
  - max(abs(drive.torque.rz)) < 2 N*m
"""
HEAVIER = """\
taskspec: 1
robot:
  model: ur5e
  tool: {length: 120 mm, mass: 0.5 kg}
  start: {xyz: [450 mm, 100 mm, 350 mm]}
  sensor: {at: wrist}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
frame: table
limits: {force: 60 N}
stages:
  approach:
    axes: {z: {velocity: -20 mm/s}}
    until: norm(force) > 5 N for 10 ms
    within: {time: 5 s}
  press: {axes: {z: {force: -15 N}}, time: 2 s}
  leave: {axes: {z: {move: 30 mm}}}
expect:
  - press.force.z within -15 N +- 1 N for 70 %
truth: {robot.tool.mass: 1.8 kg}
"""
TISSUE = """\
taskspec: 1
robot: {model: panda, start: {xyz: [450 mm, 0, 320 mm]}}
world:
  fat: {shape: box, size: [200 mm, 200 mm, 100 mm], xyz: [400 mm, 0, 250 mm], stiffness: 1 kN/m}
  bone: {shape: box, size: [200 mm, 200 mm, 100 mm], xyz: [600 mm, 0, 250 mm], stiffness: 60 kN/m}
frame: world
limits: {force: 60 N}
stages:
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -2 N for 10 ms, within: {time: 5 s}}
  scan: {axes: {z: {force: -5 N}, x: {move: 100 mm, speed: 20 mm/s}}}
  leave: {axes: {z: {move: 30 mm}}}
expect:
  - scan.force.z within -5 N +- 2 N for 90 %
"""
LATE = """\
taskspec: 1
robot:
  model: ur5e
  start: {xyz: [450 mm, 100 mm, 320 mm]}
  sensor: {rate: 125 Hz, delay: 16 ms, noise: 1 N}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 200 kN/m}}
frame: table
control: {rate: 125 Hz}
limits: {force: 100 N}
stages:
  approach: {axes: {z: {velocity: -10 mm/s}}, until: force.z < -8 N, within: {time: 5 s}}
  press: {axes: {z: {force: -20 N}}, time: 4 s}
  leave: {axes: {z: {move: 30 mm}}}
expect:
  - press.force.z within -20 N +- 3 N for 60 %
"""


@pytest.mark.parametrize("guard", ["8 N", "2 N"])
def test_a_declared_bias_makes_an_expectation_miss(guard):
    text = BIASED.replace("GUARD", guard)
    finding = found(text, "TS726")
    assert serious(text) == ["TS726"]
    assert place_of(finding, text)[0] == len(text.splitlines())
    assert "measured as -10 N where the tool applies -14 N" in finding.message
    assert "a declared bias of 4 N that no stage has tared" in finding.message
    assert "tare: true" in finding.hint


def test_a_tare_before_the_touch_is_the_remedy_for_the_bias():
    text = BIASED.replace("GUARD", "2 N").replace(
        "stages:\n", "stages:\n  zero: {time: 0.5 s, tare: true}\n"
    )
    assert serious(text) == []


@pytest.mark.parametrize(("mass", "most"), [("3 kg", "8 N"), ("1 kg", "3 N")])
def test_the_inertia_of_a_tool_makes_a_guard_hold_in_the_air(mass, most):
    text = INERTIA.replace("MASS", mass).replace("MOST", most)
    finding = found(text, "TS618")
    assert place_of(finding, text) == (13, f"norm(force) > {most}")
    assert "where the tool applies 0 N" in finding.message
    assert f"the tool's {mass}, accelerated with" in finding.message
    assert "accelerate more gently" in finding.hint


def test_a_joint_that_a_mechanism_turns_ends_the_run():
    finding = found(CAP, "TS424")
    assert serious(CAP) == ["TS424"]
    assert place_of(finding, CAP) == (12, "rz")
    assert "position limit of joint 7" in finding.message
    assert "'cap' takes it along: it goes from 45 deg to 166 deg" in finding.message
    assert "joint 7 turned back" in finding.hint


def test_a_wrong_weight_makes_a_guard_hold_in_the_air():
    finding = found(HEAVIER, "TS614")
    assert place_of(finding, HEAVIER) == (13, "norm(force) > 5 N for 10 ms")
    assert "with nothing touched" in finding.message
    assert "the tool weighs 12.8 N more than its nominal mass" in finding.message
    assert "true mass" in finding.hint
    # What follows from it has the same cause.
    assert "weighs 12.8 N more" in found(HEAVIER, "TS726").message


@pytest.mark.parametrize("longer", [False, True])
def test_a_step_of_stiffness_that_the_run_passes_is_a_remark(longer):
    stay = "  stay: {axes: {z: {force: -5 N}}, time: 4 s}\n  leave:"
    text = TISSUE.replace("  leave:", stay) if longer else TISSUE
    assert serious(text) == []
    predicted = [each for each in checked(text).findings if each.code == "TS501"]
    assert [each.severity for each in predicted] == [Severity.INFO]


def test_noise_that_a_lightly_damped_loop_amplifies_misses_an_expectation():
    finding = found(LATE, "TS726")
    assert place_of(finding, LATE)[0] == len(LATE.splitlines())
    assert "of a sensor's noise of 1 N" in finding.message
    assert "with a damping ratio of 0.067, which amplifies it" in finding.message
    assert "lower the force gains" in finding.hint


def test_the_inside_of_a_bowl_is_wiped():
    """t13, from the centre on: a bowl is a sphere with `side: inner`, which the first word says.

    At 30 mm/s on 150 mm the tool turns by 0.2 rad/s, towards where it goes.
    """
    with pytest.raises(SpecError) as refused:
        load_text(BOWL.replace("SHAPE", "shape: bowl"), "task.yaml")
    (only,) = refused.value.diagnostics
    assert (only.code, only.span.line) == ("TS025", 4)
    assert "a sphere with side: inner" in only.hint
    text = BOWL.replace("SHAPE", "shape: sphere, side: inner")
    # With the tool of 100 mm that is there by default the wrist meets the rim, 150 mm above.
    assert serious(text) == ["TS428"]
    assert serious(text.replace("model: panda,", "model: panda, tool: {length: 200 mm},")) == []


def test_a_part_that_is_a_mesh_says_its_unit():
    """t13b: STL has no unit, so that the file says it; and the file has to be there."""
    text = BOWL.replace("SHAPE, radius: 150 mm", "shape: mesh, file: part.stl")
    with pytest.raises(SpecError) as refused:
        load_text(text, "task.yaml")
    unit, file = refused.value.diagnostics
    assert (unit.code, unit.message) == ("TS301", "a mesh needs 'unit'")
    assert (file.code, file.message) == ("TS333", "there is no file 'part.stl'")
    assert place_of(file, text) == (4, "part.stl")
