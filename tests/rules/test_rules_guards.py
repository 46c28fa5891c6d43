"""Guards that cannot do what they are for."""

from __future__ import annotations

import re

import numpy as np
import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 340 mm]}}
world: {WORLD}
frame: table
limits: {force: 40 N, speed: 250 mm/s}
stages:
  go: {axes: {AXES}, until: UNTIL, within: {time: 4 s, travel: 60 mm}}
"""
TABLE = "table: {shape: plane, xyz: [0, 0, 300 mm], friction: 0.2}"
CEILING = "top: {shape: plane, xyz: [0, 0, 700 mm], rpy: [180 deg, 0, 0]}"


def codes(until, axes="z: {velocity: -20 mm/s}", world=TABLE):
    text = TASK.replace("UNTIL", until).replace("AXES", axes).replace("WORLD", world)
    return [d.code for d in check_task(load_text(text, "t"))]


@pytest.mark.parametrize(
    ("until", "expected"),
    [
        ("force.z < -2 N for 10 ms", []),
        ("norm(force) > 2 N", []),
        ("force.z < -45 N", ["TS611"]),
        ("norm(force) < -1 N", ["TS611"]),
        ("t > 3.9 s", []),
        ("t > 4.1 s", ["TS611"]),
        ("travel > 80 mm", ["TS611"]),
        ("velocity.z < -300 mm/s", ["TS611"]),
        ("touching for 5 s", ["TS611"]),
        ("joint.1.position > 180 deg", ["TS611"]),
        ("tilt > 190 deg", ["TS611"]),
        ("gap < 1 mm and gap > 2 mm", ["TS611"]),
        ("force.z > 2 N", ["TS612"]),
        ("2 N < force.z", ["TS612"]),
        # Without a touch that ends it, it presses until the limit on force stops the run at 2.78 s.
        ("force.z > 2 N or t > 3 s", ["TS616"]),
        ("force.z > -2 N", ["TS613"]),
        ("not touching", ["TS613"]),
        ("gap within 3 mm +- 0.1 mm", []),
        ("gap > 1 mm or force.z < -2 N", []),
    ],
)
def test_guards(until, expected):
    assert codes(until) == expected


def test_the_other_sign_is_right_where_something_pushes_the_other_way():
    assert codes("force.z > 2 N", world=f"{TABLE}, {CEILING}") == []
    assert codes("force.z > 2 N", axes="z: {velocity: 10 mm/s}") == ["TS617"]


CRANK = "crank: {mechanism: hinge, xyz: [480 mm, 0, 350 mm], handle: [100 mm, 0, 0], knob: free%s}"
DRAWER = "drawer: {mechanism: slide, xyz: [500 mm, 0, 350 mm], rpy: [0, 90 deg, 0]%s}"


@pytest.mark.parametrize(
    ("world", "rate", "until", "expected"),
    [
        # 60 mm/s at 100 mm for 4 s are 137.5 deg.
        (CRANK, "y: {velocity: 60 mm/s}", "crank.angle > 130 deg", []),
        (CRANK, "y: {velocity: 60 mm/s}", "crank.angle > 160 deg", ["TS611"]),
        (CRANK, "y: {velocity: -60 mm/s}", "crank.angle > 90 deg", ["TS611"]),
        (CRANK, "y: {velocity: -60 mm/s}", "crank.angle < -90 deg", []),
        (CRANK, "y: {velocity: 60 mm/s * t/(1 s)}", "crank.angle < -90 deg",
         ["TS424"]),  # it turns the other way until joint 7 is at its end, after 3.46 s
        (CRANK % ", stop: 0..80 deg%s", "y: {velocity: 60 mm/s}", "crank.angle > 130 deg",
         ["TS328", "TS611"]),
        (DRAWER, "z: {velocity: 50 mm/s}", "drawer.travel > 150 mm", []),
        (DRAWER, "z: {velocity: 50 mm/s}", "drawer.travel > 250 mm", ["TS611"]),
        (DRAWER, "z: {velocity: 50 mm/s}", "drawer.travel < -50 mm", ["TS611"]),
        (DRAWER % ", stop: 0..100 mm%s", "z: {velocity: 50 mm/s}", "drawer.force > 35 N", []),
        # It is a part of the force on the tool, which the limit of 40 N bounds.
        (DRAWER % ", stop: 0..100 mm%s", "z: {velocity: 50 mm/s}", "drawer.force > 45 N",
         ["TS611"]),
    ],
)  # fmt: skip
def test_how_far_a_mechanism_is_driven(world, rate, until, expected):
    name = world.partition(":")[0]
    others = {"crank": "x: {force: 0}, z: {force: 0}", "drawer": "x: {force: 0}, y: {force: 0}"}
    text = TASK.replace("start: {xyz: [500 mm, 0, 340 mm]}", f"grasp: {name}.handle")
    text = text.replace("frame: table", f"frame: {name}.handle").replace(", travel: 60 mm", "")
    text = text.replace("UNTIL", until).replace("WORLD", world % "")
    text = text.replace("AXES", f"{rate}, {others[name]}")
    found = [d.code for d in check_task(load_text(text, "t"))]
    assert [code for code in found if not code.startswith("TS5")] == expected


def test_the_sign_is_told_with_what_would_be_right():
    (found,) = check_task(
        load_text(
            TASK.replace("UNTIL", "force.z >= 1.5*2 N")
            .replace("AXES", "z: {velocity: -20 mm/s}")
            .replace("WORLD", TABLE),
            "t",
        )
    )
    assert "did you mean 'force.z <= -(1.5*2 N)'?" in found.hint


CARRIED = """
taskspec: 1
robot: {model: ur5e, grasp: part}
world:
  part: {shape: box, size: [74 mm, 74 mm, 74 mm], free: true, mass: 170 g, stiffness: 1.1 kN/m,
    damping: 13 N*s/m, xyz: [490 mm, 158 mm, 240 mm]}
  table: {shape: plane, xyz: [0, 0, 163 mm], stiffness: 1.1 kN/m, damping: 13 N*s/m}
frame: world
law: pd
stages:
  go: {axes: {z: {velocity: -14 mm/s}}, until: UNTIL, within: {time: 3.9 s, travel: 60 mm}}
"""


@pytest.mark.parametrize(
    ("until", "expected"),
    [
        ("norm(force) > 1.1 N for 5 ms", ["TS613"]),
        ("force.z > 1.1 N", ["TS613"]),
        ("norm(force) > 2.4 N for 5 ms", []),
        ("force.z < -1.1 N", []),
        ("touching for 10 ms", ["TS613"]),
    ],
)
def test_the_weight_of_what_is_held_ends_a_stage_at_once(simulate, until, expected):
    """170 g weigh 1.67 N. The part is 40 mm off its table, 2.9 s away."""
    text = CARRIED.replace("UNTIL", until)
    assert [d.code for d in check_task(load_text(text, "t"))] == expected
    ended = simulate(text).transitions[0]
    assert (ended.clock < 0.1) == bool(expected)
    assert ended.kind == "until"


def test_a_sensor_that_is_tared_takes_the_weight_off():
    text = CARRIED.replace("UNTIL", "norm(force) > 1.1 N for 5 ms")
    tared = text.replace("stages:\n", "stages:\n  zero: {axes: {}, tare: true, time: 0.3 s}\n")
    assert not check_task(load_text(tared, "t"))


def test_a_part_that_is_held_comes_to_its_table_before_the_tool_does(simulate):
    """The part begins 40 mm off; the force that the guard waits for comes a little later."""
    text = CARRIED.replace("UNTIL", "force.z < -1.1 N")
    short = text.replace("time: 3.9 s", "time: 2.6 s")
    (found,) = check_task(load_text(short, "t"))
    predicted = float(re.search(r"after ([\d.]+) s", found.message)[1])
    assert found.code == "TS617"
    assert simulate(short).transitions[0].kind == "within"
    touches = simulate(text)
    arrives = touches["t"][np.argmax(touches["force.z"] < 0.5 * 0.17 * 9.81)]
    assert predicted == pytest.approx(arrives, abs=0.15)
    assert predicted < touches.transitions[0].clock


@pytest.mark.parametrize("law", ["pd", "impedance-natural"])
def test_an_open_loop_force_counts_from_what_is_held(simulate, law):
    """The part reaches 37 mm below the tool: the spring is displaced from there.

    With the set point f_d it is at f_d (1/k_m + 1/k); the robot applies f, and the table bears
    W - f, the part's weight W with it: f = f_d + W k_m / (k_m + k). The grip, 50 kN/m, is left out.
    """
    text = CARRIED.replace("UNTIL", "force.z < -1.1 N").replace("law: pd", f"law: {law}")
    press = "  press: {axes: {z: {force: -6 N}}, time: 1.5 s}\n"
    run = simulate(text + press)
    own = run.program.plan.stages["press"].gains["stiffness"]["z"].value
    weight, k = 0.17 * 9.81, 1100.0
    share = weight / k / (1 / k + 1 / own)
    assert run.outcome.status == "done"
    assert run.during("press", "force.z", 1.4) == pytest.approx(-6.0 + share, abs=0.1)


VALVE = """
taskspec: 1
robot: {model: panda, grasp: valve.handle, start: {rpy: [180 deg, 0, 90 deg]}}
world:
  valve: {mechanism: hinge, xyz: [490 mm, 0, 350 mm], inertia: 0.01 kg*m^2,
    damping: 0.2 N*m*s/rad, friction: 0.5 N*m}
frames: {believed: {parent: valve, rpy: [2 deg, 0, 0]}}
frame: believed
law: hybrid
stages:
  close:
    axes: {x: {force: 0}, y: {force: 0}, z: {force: 0}, rx: {torque: 0}, ry: {torque: 0},
      rz: {velocity: -30 deg/s}}
    until: position.rz < ANGLE
    within: 1 s
"""


@pytest.mark.parametrize(("angle", "expected"), [("-20 deg", []), ("-31 deg", ["TS611"])])
def test_a_turn_that_its_bound_ends_first_is_announced(simulate, angle, expected):
    """In 1 s the reference turns by 28.5 deg; 4 % and 1 deg more are let go."""
    text = VALVE.replace("ANGLE", angle)
    assert [d.code for d in check_task(load_text(text, "t"))] == expected
    assert simulate(text).transitions[0].kind == ("within" if expected else "until")


HANDED = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 300 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m}}
frame: table
law: hybrid
stages:
  settle: {axes: {z: {force: BEFORE}}, time: 0.6 s}
  press: {axes: {z: {force: -16 N}}, until: UNTIL, within: {time: 0.8 s}}
"""


@pytest.mark.parametrize(
    ("before", "until", "expected"),
    [
        ("-16 N", "abs(force.z) > 10 N", ["TS613"]),
        ("-16 N", "force.z < -10 N", ["TS613"]),
        ("-5 N", "abs(force.z) > 10 N", []),
        ("-16 N", "abs(force.z) > 10 N for 0.3 s", []),
        ("-16 N", "abs(force.z) > 10 N and t > 0.3 s", []),
    ],
)
def test_a_force_that_is_handed_over_ends_a_stage_at_once(simulate, before, until, expected):
    text = HANDED.replace("BEFORE", before).replace("UNTIL", until)
    assert [d.code for d in check_task(load_text(text, "t"))] == expected
    run = simulate(text)
    lasted = run.transitions[-1].clock - run.transitions[0].clock
    assert (lasted < 5e-3) == bool(expected)
