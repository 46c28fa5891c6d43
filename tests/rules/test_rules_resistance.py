"""Force set points against what the world can return, by rank."""

from __future__ import annotations

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

HEAD = "taskspec: 1\nname: resists\n"


def codes(world, axes, robot="model: panda, start: {xyz: [500 mm, 0, 310 mm]}", **more):
    keys = {"frame": "world", "law": "hybrid"} | more
    text = f"{HEAD}robot: {{{robot}}}\nworld: {{{world}}}\nframes: {{skin: {{surface: drum}}}}\n"
    if "drum" not in world:
        text = text.replace("frames: {skin: {surface: drum}}\n", "")
    text += "".join(f"{k}: {v}\n" for k, v in keys.items())
    text += f"stages: {{go: {{axes: {{{axes}}}, time: 1 s}}}}\n"
    found = [d.code for d in check_task(load_text(text, "t"))]
    # Whether a loop rings on what resists it, whether the frame is used and whether a link is in
    # the drum, which is longer than the arm is far, is another matter.
    other = ("TS130", "TS428")
    return [code for code in found if not code.startswith("TS5") and code not in other]


FLOOR = "floor: {shape: plane, xyz: [0, 0, 310 mm]FRICTION}"
WALL = "wall: {shape: plane, xyz: [510 mm, 0, 0], rpy: [0, -90 deg, 0]}"
DRUM = (
    "drum: {shape: cylinder, xyz: [500 mm, 0, 210 mm], rpy: [0, 90 deg, 0], radius: 100 mm, "
    "length: 1 m}"
)
RIM = 'rim: {equation: "x^2 + y^2 = (500 mm)^2"}'


@pytest.mark.parametrize(
    ("world", "axes", "more", "expected"),
    [
        (FLOOR, "x: {force: 5 N}", {}, ["TS420"]),
        (FLOOR, "x: {force: 5 N}, z: {force: -9 N}", {}, ["TS420"]),
        (FLOOR, "z: {force: -5 N}", {}, []),
        (FLOOR, "x: {force: 0}", {}, ["TS325"]),
        (FLOOR, "x: {force: 0}", {"law": "parallel"}, []),
        (FLOOR, "z: {force: 0}", {}, []),
        (FLOOR, "rx: {torque: 0}", {}, ["TS325"]),
        (FLOOR.replace("FRICTION", ", friction: 0.3"), "x: {force: 0}", {}, []),
        (FLOOR, "x: {force: 5 N * sin(2*pi*t/(1 s))}", {}, ["TS320"]),
        (FLOOR, "x: {force: -20 N*s/m * velocity.x}", {}, []),
        (f"{FLOOR}, {WALL}", "x: {force: 5 N * sin(pi*t/(1 s))}", {}, []),
        (FLOOR.replace("FRICTION", ", friction: 0.3"), "x: {force: 1 N * t/(9 s)}", {}, []),
        (FLOOR, "rx: {torque: 1 N*m}", {}, ["TS420"]),
        (DRUM, "x: {force: 5 N}", {"frame": "skin"}, ["TS420"]),
        (DRUM, "x: {force: 5 N}", {}, ["TS327"]),  # Beside its end something might stand.
        (RIM, "x: {force: 5 N}", {}, []),
        (RIM, "y: {force: 5 N}", {}, []),
        (RIM, "z: {force: 5 N}", {}, ["TS320"]),
        (RIM, "z: {force: 5 N}", {"law": "parallel"}, ["TS320"]),
        ("", "z: {force: 5 N}", {}, ["TS320"]),
        ("", "z: {force: 5 N}", {"law": "pd"}, ["TS303"]),
        ('bar: {equation: "q1 = 0"}', "z: {force: 5 N}", {}, []),
    ],
)
def test_forces(world, axes, more, expected):
    assert codes(world.replace("FRICTION", ""), axes, **more) == expected


@pytest.mark.parametrize(
    ("knob", "axes", "expected"),
    [
        ("free", "y: {force: 2 N}", []),
        ("free", "rx: {torque: 0.1 N*m}", []),
        ("free", "rz: {torque: 0.1 N*m}", ["TS320"]),
        ("free", "rz: {torque: 0}", ["TS325"]),
        ("fixed", "rz: {torque: 0.1 N*m}", []),
        ("fixed", "y: {velocity: 50 mm/s}, x: {force: 0}, rz: {torque: 0}", []),
    ],
)
def test_what_is_held(knob, axes, expected):
    """A door at its handle with y velocity and rz torque 0 is well posed."""
    shape = f"mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0], knob: {knob}"
    held = {"robot": "model: panda, grasp: door.handle", "frame": "door.handle"}
    assert codes(f"door: {{{shape}}}", axes, **held) == expected


def test_free_axes_of_a_stage_are_one_finding():
    """A hand guides the tool: six axes are free, which is said once."""
    forces = ", ".join(f"{axis}: {{force: 0}}" for axis in "xyz")
    moments = ", ".join(f"r{axis}: {{torque: 0}}" for axis in "xyz")
    stages = (
        f"a: {{axes: {{{forces}, {moments}}}, time: 1 s}}, b: {{axes: {{{forces}}}, time: 1 s}}"
    )
    text = f"{HEAD}robot: {{model: panda}}\nlaw: hybrid\nstages: {{{stages}}}\n"
    first, second = check_task(load_text(text, "t"))
    assert {first.code, second.code} == {"TS325"}
    assert first.message.startswith(
        "nothing determines 'x', 'y', 'z', 'rx', 'ry' and 'rz': no force or moment is commanded, "
        "and there is nothing in the world to push on;"
    )
    assert second.message.startswith("nothing determines 'x', 'y' and 'z': no force is commanded")
    assert first.hint == "hold them or move them, unless the tool is to go and turn freely"
    assert text.splitlines()[first.span.line - 1][first.span.column - 1 :].startswith("axes: {x")
