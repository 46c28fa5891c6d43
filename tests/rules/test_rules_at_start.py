"""Findings that need the robot, its start, its axes and its contacts."""

from __future__ import annotations

import re

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
name: checked
robot: {ROBOT}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], CONTACT}
  block: {shape: box, size: [1 m, 1 m, 10 mm]}
frames: {task: {surface: table}, FRAMES}
frame: FRAME
law: LAW
stages:
  go: {STAGE}
expect: [EXPECT]
VARY
"""
GOOD = {
    "ROBOT": "model: panda, start: {xyz: [500 mm, 0, 340 mm]}",
    "CONTACT": "stiffness: 20 kN/m",
    "FRAMES": "",
    "FRAME": "task",
    "LAW": "hybrid",
    "STAGE": "axes: {z: {velocity: -20 mm/s}}, until: touching, within: {time: 3 s}",
    "EXPECT": "max(norm(force)) < 40 N",
    "VARY": "",
}


def codes(**changes: str) -> list[str]:
    text = TASK
    for key, value in (GOOD | changes).items():
        text = text.replace(key, value)
    return [d.code for d in check_task(load_text(text, "task.yaml"))]


def test_a_sound_task_has_no_findings():
    assert codes() == []


PLANAR = "model: planar3, start: {xyz: [450 mm, 100 mm, 0]}"


@pytest.mark.parametrize(
    ("code", "changes"),
    [
        ("TS401", {"ROBOT": "model: pando"}),
        ("TS412", {"ROBOT": "model: panda, start: {xyz: [3 m, 0, 0]}"}),
        ("TS411", {"ROBOT": "model: panda, posture: [0, 0]"}),
        ("TS220", {"ROBOT": PLANAR, "FRAME": "world"}),
        (
            "TS221",
            {"ROBOT": PLANAR, "FRAME": "jig", "FRAMES": "jig: {rpy: [0, 20 deg, 0]}"},
        ),
        ("TS222", {"STAGE": "axes: {x: hold}, path: {line: {by: [10 mm]}, time: 1 s}"}),
        ("TS223", {"STAGE": "path: {file: nowhere.csv, speed: 1 mm/s}"}),
        ("TS224", {"STAGE": "axes: {z: {force: -1 N}}, until: error.z > 1 m, within: {time: 1 s}"}),
        ("TS224", {"STAGE": "until: tilt in world > 1 deg, within: {time: 1 s}"}),
        ("TS224", {"STAGE": "until: table.force > 1 N, within: {time: 1 s}"}),
        ("TS224", {"STAGE": "until: joint.9.position > 1 rad, within: {time: 1 s}"}),
        ("TS224", {"STAGE": "axes: {x: {velocity: joint.1.torque / (1 N*s)}}, time: 1 s"}),
        ("TS117", {"STAGE": "axes: {x: {position: 1 mm / (t/(1 s))}}, time: 1 s"}),
        ("TS225", {"FRAMES": "up: {surface: table, heading: [0, 0, 1]}", "FRAME": "up"}),
        ("TS226", {"FRAMES": "on: {parent: task}", "FRAME": "on"}),
        ("TS227", {"STAGE": "path: {line: {by: [0, 0, 0, 10 deg]}, speed: 1 mm/s}"}),
        (
            "TS304",
            {
                "LAW": "impedance",
                "STAGE": "axes: {z: {force: -5 N}}, time: 1 s",
                "VARY": "vary: {world.table.stiffness: 3..40 kN/m}",
            },
        ),
        ("TS305", {"ROBOT": "model: panda, start: {xyz: [500 mm, 0, 299 mm]}"}),
        (
            "TS306",
            {
                "LAW": "{kind: pd, stiffness: {z: 0}}",
                "STAGE": "axes: {z: {force: -5 N}}, time: 1 s",
            },
        ),
        ("TS308", {"STAGE": "axes: {z: {force: 5 N}}, time: 1 s"}),
        ("TS308", {"STAGE": "axes: {z: {force: -5 N}}, time: 1 s", "FRAME": "tool"}),
        ("TS610", {"STAGE": "axes: {z: {force: -5 N}}, time: 1 s, limits: {force: 4 N}"}),
        ("TS306", {
            "LAW": "{kind: pd, stiffness: {rz: 0}}",
            "STAGE": "axes: {rz: {torque: 1 Nm}}, time: 1 s",
        }),
        ("TS414", {"LAW": "{kind: pd-joint, damping: [1 N*m*s/rad, 2 N*m*s/rad]}"}),
        ("TS414", {"ROBOT": "model: panda, joint_damping: [1 N*m*s/rad, 0]"}),
        ("TS233", {"ROBOT": "model: ur5e", "LAW": "{kind: pd, null_space: joint-limits}"}),
        ("TS307", {"CONTACT": "stiffness: 50000 kN/m"}),
    ],
)  # fmt: skip
def test_findings(code, changes):
    assert code in codes(**changes)


def test_a_force_without_a_surface():
    text = """
taskspec: 1
name: bare
robot: {model: panda}
law: pd
stages: {go: {axes: {z: {force: -5 N}}, time: 1 s}}
"""
    assert [d.code for d in check_task(load_text(text, "t"))] == ["TS303"]


def test_an_open_loop_force_is_bounded_by_the_corners():
    """20 N at k_m = 1 kN/m for 10 kN/m: (4.26), (4.27) with 5 and 20 kN/m and 1 mm up or down."""
    text = TASK
    changes = GOOD | {
        "LAW": "{kind: pd, stiffness: {z: 1 kN/m}}",
        "CONTACT": "stiffness: 10 kN/m",
        "STAGE": "axes: {z: {force: -20 N}}, time: 1 s",
        "VARY": "vary: {world.table.stiffness: 5..20 kN/m, world.table.xyz: [0, 0, +- 1 mm]}",
    }
    for key, value in changes.items():
        text = text.replace(key, value)
    (found,) = check_task(load_text(text, "t"))
    depth = 20 / 1000 + 20 / 10_000
    worst = (depth + 1e-3) * 1000 * 20_000 / 21_000
    least = (depth - 1e-3) * 1000 * 5_000 / 6_000
    assert f"{-worst:.3g} N to {-least:.3g} N" in found.message


def test_what_is_held_is_not_touched():
    """The tip is inside a body that it holds by its middle, and that lies on a table."""
    text = """
taskspec: 1
name: lift
robot: {model: panda, grasp: cube}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm]}
  cube:
    {shape: box, size: [40 mm, 40 mm, 40 mm], xyz: [500 mm, 0, 320 mm], free: true, mass: 500 g}
frame: table
stages: {lift: {axes: {z: {move: 50 mm}}}}
"""
    assert check_task(load_text(text, "t")) == ()
    loose = text.replace("grasp: cube", "start: {xyz: [500 mm, 0, 320 mm]}")
    assert [d.code for d in check_task(load_text(loose, "t"))] == ["TS305"]


@pytest.mark.parametrize(("tilt", "codes"), [("5 deg", []), ("-5 deg", ["TS305"])])
def test_the_sides_of_a_peg_are_inside_a_plate(tilt, codes):
    """Its end is in the middle of the bore either way; tilted by 10 deg its side is in the rim.

    There it is 18 tan 10 deg - 0.1 = 3.1 mm deep, of which points on it have most.
    """
    text = f"""
taskspec: 1
robot:
  model: panda
  tool: {{shape: cylinder, radius: 9.9 mm, thickness: 40 mm, length: 140 mm}}
  start: {{xyz: [498.43 mm, 0, 282.07 mm], rpy: [180 deg, {tilt}, 0]}}
world:
  socket: {{shape: hole, radius: 10 mm, depth: 25 mm, chamfer: 1 mm, xyz: [500 mm, 0, 300 mm],
            rpy: [0, 5 deg, 0], stiffness: 100 kN/m}}
frame: socket
stages: {{pull: {{axes: {{z: {{move: 30 mm, speed: 20 mm/s}}}}}}}}
"""
    found = [d for d in check_task(load_text(text, "t")) if d.code == "TS305"]
    assert [d.code for d in found] == codes
    for each in found:
        depth = float(re.search(r"starts ([\d.]+) mm", each.message)[1])
        assert 0.8 * 3.07 < depth < 3.07
