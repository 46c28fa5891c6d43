"""Which object each axis of a stage presses on: by name, by frame, or ahead of the tool."""

from __future__ import annotations

import math

import numpy as np
import pytest

from taskspec.examination import check_task
from taskspec.geometry.axis import Axis
from taskspec.planning import plan_task
from taskspec.program.plan import TaskPlan
from taskspec.program.stages.stage import compile_stage
from taskspec.spec import load_text

R = 0.02
DOWN, SIDE = np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0])
HEAD = """\
taskspec: 1
robot: {{model: panda, start: {{xyz: [500 mm, 0, 340 mm]}}, tool: {{shape: sphere, radius: 20 mm}}}}
world: {{{world}}}
stages:
{stages}
"""
TABLE = "table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}"
SLOWLY = "{velocity: -5 mm/s}"
SOFT = "size: [1 m, 20 mm, 0.2 m], stiffness: 500 N/m"
FENCE = f"fence: {{shape: box, xyz: [500 mm, 41 mm, 340 mm], {SOFT}}}"


def planned(world: str, *stages: str, head: str = HEAD) -> TaskPlan:
    text = head.format(world=world, stages="\n".join(f"  {stage}" for stage in stages))
    task = plan_task(load_text(text, "contacts.yaml"))
    for name in task.stages:
        task.follow(name)
    return task


def ahead(shape: str, direction: np.ndarray, xyz: str = "[500 mm, 0, 200 mm]"):
    context = planned(f"it: {{shape: {shape}, xyz: {xyz}}}", "rest: {time: 1 s}").context
    return context.obstacles.first(context.start_p, context.start_R, direction)


@pytest.mark.parametrize(
    ("shape", "direction", "way"),
    [
        ("plane", DOWN, 0.14),
        ("plane, rpy: [30 deg, 0, 0]", DOWN, 0.14 + R - R / math.cos(math.radians(30))),
        ("plane", np.array([0.6, 0.0, -0.8]), 0.14 / 0.8),
        ("sphere, radius: 50 mm", DOWN, 0.09),
        ("box, size: [100 mm, 100 mm, 60 mm]", DOWN, 0.11),
        ("cylinder, radius: 30 mm, length: 0.3 m, rpy: [90 deg, 0, 0]", DOWN, 0.11),
    ],
)
def test_the_way_to_a_shape_is_that_of_its_closed_form(shape, direction, way):
    """From the ball's centre at 360 mm: the tip is its lowest point."""
    met = ahead(shape, direction)
    assert met is not None
    assert met.way == pytest.approx(way, abs=1e-8)
    assert float(met.normal @ direction) < 0


def test_a_sphere_is_met_off_its_middle():
    """(x - a)^2 + z^2 = (r + R)^2 at an offset a."""
    met = ahead("sphere, radius: 50 mm", DOWN, "[500 mm, 30 mm, 200 mm]")
    height = math.sqrt(0.07**2 - 0.03**2)
    assert met.way == pytest.approx(0.16 - height, abs=1e-8)
    assert met.normal == pytest.approx(np.array([0.0, -0.03, height]) / 0.07, abs=1e-6)


@pytest.mark.parametrize(
    ("shape", "direction", "xyz"),
    [
        ("plane", -DOWN, "[500 mm, 0, 200 mm]"),
        ("plane", SIDE, "[500 mm, 0, 200 mm]"),
        ("sphere, radius: 50 mm", DOWN, "[500 mm, 71 mm, 200 mm]"),
        ("box, size: [100 mm, 100 mm, 60 mm]", DOWN, "[500 mm, 71 mm, 200 mm]"),
        ("plane, rpy: [90.5 deg, 0, 0]", DOWN, "[500 mm, 60 mm, 200 mm]"),
    ],
)
def test_what_the_way_passes_by_is_not_met(shape, direction, xyz):
    assert ahead(shape, direction, xyz) is None


def test_each_axis_has_the_object_ahead_of_it():
    task = planned(
        f"{TABLE}, {FENCE}",
        "corner: {axes: {y: {force: 2 N}, z: {force: -5 N}}, time: 1 s}",
        "off: {axes: {y: {velocity: -10 mm/s}}, time: 1 s}",
    )
    corner = task.stages["corner"]
    assert corner.contacts.by_axis == {"x": None, "y": "fence", "z": "table"}
    assert corner.contacts.of_gap is None
    assert corner.contacts.touched == ("table", "fence")
    assert corner.environment.by_axis["y"] == 500.0
    assert corner.environment.by_axis["z"] == 20e3
    # Friction along x would be that of what the stage is about.
    assert corner.contacts.of(Axis.X) == "table"
    assert task.stages["off"].contacts.by_axis["y"] == "fence"  # which the tool leaves


def test_a_pad_that_is_nearer_but_never_touched_decides_nothing():
    size = "size: [20 mm, 20 mm, 20 mm], stiffness: 100 N/m"
    pad = f"pad: {{shape: box, xyz: [500 mm, 35 mm, 340 mm], {size}}}"
    alone = planned(TABLE, "press: {axes: {z: {force: -5 N}}, time: 1 s}")
    beside = planned(f"{TABLE}, {pad}", "press: {axes: {z: {force: -5 N}}, time: 1 s}")
    context = beside.context
    assert min(context.start_gaps, key=lambda o: context.start_gaps[o]) == "pad"
    assert beside.stages["press"].contacts.main == "table"
    assert beside.stages["press"].gains == alone.stages["press"].gains


def test_the_object_ahead_is_looked_for_from_where_the_stage_starts():
    """The shelf lies at the side of the start, and ahead once the tool has gone there."""
    shelf = "shelf: {shape: box, xyz: [500 mm, 150 mm, 310 mm], size: [100 mm, 100 mm, 20 mm]}"
    task = planned(
        f"{TABLE}, {shelf}",
        f"here: {{axes: {{z: {SLOWLY}}}, time: 1 ms}}",
        "over: {axes: {y: {move: 150 mm}}}",
        f"there: {{axes: {{z: {SLOWLY}}}, until: force.z < -1 N, within: {{time: 9 s}}}}",
    )
    assert task.stages["here"].contacts.approached == "table"
    there = task.stages["there"].kinematics.tool[0]
    assert there[1] == pytest.approx(0.15)
    assert task.stages["there"].contacts.approached == "shelf"


def test_the_file_names_the_object():
    force = "{force: -5 N, contact: fence}"
    task = planned(
        f"{TABLE}, {FENCE}",
        f"axis: {{axes: {{z: {force}}}, time: 1 s}}",
        "all: {contact: fence, axes: {z: {force: -5 N}}, time: 1 s}",
        "one: {contact: fence, axes: {z: {force: -5 N, contact: table}}, time: 1 s}",
    )
    assert task.stages["axis"].contacts.by_axis == {"x": None, "y": "fence", "z": "fence"}
    assert set(task.stages["all"].contacts.by_axis.values()) == {"fence"}
    assert task.stages["one"].contacts.by_axis == {"x": "fence", "y": "fence", "z": "table"}


def test_a_force_along_a_followed_surface_is_returned_by_what_stands_on_it():
    task = planned(
        f"{TABLE}, {FENCE}",
        "corner: {axes: {y: {force: 2 N}, z: {force: -5 N}}, time: 1 s}",
        head=HEAD + "frames: {{on: {{surface: table}}}}\nframe: on\n",
    )
    assert task.stages["corner"].contacts.by_axis == {"x": "table", "y": "fence", "z": "table"}


def findings(world: str, *stages: str) -> list[str]:
    text = HEAD.format(world=world, stages="\n".join(f"  {stage}" for stage in stages))
    return [d.code for d in check_task(load_text(text, "contacts.yaml"))]


def test_a_followed_surface_has_its_gap_where_forces_press_on_several_objects():
    task = planned(
        f"{TABLE}, {FENCE}",
        "corner: {axes: {y: {force: 2 N}, z: {force: -5 N}}, time: 1 s}",
        head=HEAD + "frames: {{on: {{surface: table}}}}\nframe: on\n",
    )
    assert task.stages["corner"].contacts.of_gap is None
    assert compile_stage(task.stages["corner"]).name == "corner"


def test_the_gap_from_several_objects_needs_a_name():
    forces = "axes: {y: {force: 2 N}, z: {force: -5 N}}, within: {time: 1 s}"
    world = f"{TABLE}, {FENCE}"
    assert "TS224" in findings(world, f"corner: {{{forces}, until: gap < 1 mm}}")
    assert "TS224" not in findings(world, f"corner: {{{forces}, until: fence.gap < 1 mm}}")
    assert "TS224" not in findings(
        world, f"corner: {{contact: fence, {forces}, until: gap < 1 mm}}"
    )


def test_names_are_checked():
    world = f"{TABLE}, door: {{mechanism: hinge, xyz: [1 m, 0, 0], handle: [0.1 m, 0, 0]}}"
    with pytest.raises(Exception, match="no object with a surface"):
        findings(world, "press: {axes: {z: {force: -5 N, contact: door}}, time: 1 s}")
    with pytest.raises(Exception, match="tabel"):
        findings(world, "press: {contact: tabel, axes: {z: {force: -5 N}}, time: 1 s}")
