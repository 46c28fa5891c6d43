"""An arm inside of bowls and tubes, on panels and meshes: force, friction, normals, agreement."""

from __future__ import annotations

import math
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
import trimesh

from taskspec.program.prepare import chart_at
from taskspec.program.world.frames import surface
from taskspec.shapes import Box, Sphere
from taskspec.shapes.mesh import UNITS, Mesh, MeshError, convex_body, read
from taskspec.spec import load_task
from taskspec.text.diagnostic import SpecError

PRESS = """
taskspec: 1
name: press
robot:
  model: panda
  tool: {tool}
  start: {{xyz: [500 mm, 0, 302 mm]}}
world:
  thing: {{{thing}, stiffness: 20 kN/m, friction: 0.2}}
frames: {{skin: {{surface: thing{heading}}}}}
frame: skin
stages:
  press: {{axes: {{z: {{force: -20 N, ramp: 0.5 s}}}}, time: 4 s}}
  wipe: {{axes: {{x: {{velocity: 20 mm/s}}, z: {{force: -20 N}}}}, time: 2 s}}
"""
BALL = "{shape: sphere, radius: 10 mm, length: 100 mm, mass: 300 g}"
DISC = "{shape: cylinder, radius: 15 mm, thickness: 10 mm, length: 100 mm, mass: 300 g}"
LYING = "length: 400 mm, rpy: [0, -90 deg, 0]"
THINGS = {
    "bowl": "shape: sphere, side: inner, radius: 150 mm, xyz: [500 mm, 0, 450 mm]",
    "shallow bowl": "shape: sphere, side: inner, arc: 40 deg, radius: 600 mm, "
    "xyz: [500 mm, 0, 900 mm]",
    "tube": f"shape: cylinder, side: inner, radius: 150 mm, {LYING}, xyz: [500 mm, 0, 450 mm]",
    "trough": "shape: cylinder, side: inner, arc: 90 deg, radius: 300 mm, "
    f"{LYING}, xyz: [500 mm, 0, 600 mm]",
    "cap": "shape: sphere, arc: 30 deg, radius: 800 mm, xyz: [500 mm, 0, -500 mm]",
    "segment": f"shape: cylinder, arc: 60 deg, radius: 300 mm, {LYING}, xyz: [500 mm, 0, 0]",
}
#: How far the contact is from the normal's turning point [m], of what bends as the frame moves.
BENDS = {"bowl": -0.150, "shallow bowl": -0.6, "cap": 0.8}


def task(thing, tool=BALL, heading=""):
    return PRESS.format(tool=tool, thing=thing, heading=heading)


@pytest.fixture(scope="session")
def parts(tmp_path_factory):
    """Files of meshes [mm], in a folder that tasks may read."""
    folder = tmp_path_factory.mktemp("parts")
    ball = trimesh.creation.icosphere(3, radius=200.0)
    block = trimesh.creation.box((300.0, 200.0, 60.0))
    ball.export(folder / "ball.stl")
    block.export(folder / "block.stl")
    block.export(folder / "block.obj")
    (folder / "ascii.stl").write_text(trimesh.exchange.stl.export_stl_ascii(block))
    trimesh.creation.cylinder(80.0, 300.0, sections=48).export(folder / "drum.stl")
    trimesh.creation.annulus(20.0, 50.0, 30.0).export(folder / "ring.stl")
    trimesh.creation.icosphere(4, radius=200.0).export(folder / "fine.stl")
    open_box = trimesh.Trimesh(block.vertices, block.faces[:-1])
    open_box.export(folder / "open.stl")
    flat = trimesh.Trimesh([(0, 0, 0), (100, 0, 0), (0, 100, 0)], [(0, 1, 2), (0, 2, 1)])
    flat.export(folder / "flat.stl")
    (folder / "none.stl").write_text("solid none\nendsolid none\n")
    (folder / "garbage.obj").write_text("f 1 2 3\nv a b c\n")
    return folder


@pytest.fixture
def _open_folder(parts, monkeypatch):
    monkeypatch.setenv("TASKSPEC_FILES", str(parts))


@pytest.mark.parametrize("tool", [BALL, DISC])
@pytest.mark.parametrize("name", list(THINGS))
def test_the_declared_stiffness_and_friction(simulate, name, tool):
    """At rest force over depth is what is declared; as it slides friction is mu N, against it.

    The force is along the normal, z of the frame, all the way.
    """
    if tool == DISC and name not in ("cap", "segment"):
        pytest.skip("a flat face is refused there")
    run = simulate(task(THINGS[name], tool))
    assert run["force.z"][3900] == pytest.approx(-20, rel=1e-3)
    force, gap = run.during("press", "force.z")[-1], run.during("press", "gap")[-1]
    # Of a flat tool the gap leaves out by how little its face bulges: 4 um on 15 mm.
    assert gap == pytest.approx(force / 20e3, abs=1e-7 if tool == BALL else 1e-5)
    along, into, aside = (run.during("wipe", f"force.{a}", 1.0) for a in "xzy")
    assert len(along) > 500
    np.testing.assert_allclose(along / -into, 0.2, rtol=0.01)
    np.testing.assert_allclose(aside, 0.0, atol=0.02)
    np.testing.assert_allclose(into, -20.0, atol=0.1)


@pytest.mark.parametrize("name", list(BENDS))
def test_the_tool_turns_with_the_normal(simulate, name):
    """20 mm/s of the foot along a radius R turn the frame at v / R, inwards in a bowl."""
    run = simulate(task(THINGS[name]))
    turn = run.during("wipe", "velocity.ry", 1.0)
    np.testing.assert_allclose(turn, 0.02 / BENDS[name], rtol=2e-3)


def _mesh(folder, file, unit="mm", xyz="[500 mm, 0, 100 mm]", rest=""):
    return f"shape: mesh, file: {folder / file}, unit: {unit}, xyz: {xyz}{rest}"


@pytest.mark.usefixtures("_open_folder")
def test_a_mesh_of_a_box_is_that_box(simulate, parts):
    """Up to the single precision of the simulator's vertices: 3e-9 m of 0.3 m, 0.1 mN."""
    block = simulate(task(_mesh(parts, "block.stl", xyz="[500 mm, 0, 270 mm]")))
    box = simulate(task("shape: box, size: [300 mm, 200 mm, 60 mm], xyz: [500 mm, 0, 270 mm]"))
    for name in ("force.x", "force.z"):
        np.testing.assert_allclose(block[name], box[name], atol=2e-3)
    np.testing.assert_allclose(block["gap"], box["gap"], atol=1e-7)
    assert block["gap"][3900] == pytest.approx(-20 / 20e3, abs=1e-6)
    ratio = block.during("wipe", "force.x", 1.0) / -block.during("wipe", "force.z", 1.0)
    np.testing.assert_allclose(ratio, 0.2, rtol=0.01)


@pytest.mark.usefixtures("_open_folder")
def test_a_mesh_of_a_sphere_is_that_sphere_up_to_its_triangles(simulate, parts):
    """The tool is where it is on the sphere, less what the facets are below it, and the normal."""
    mesh = simulate(task(_mesh(parts, "ball.stl"), heading=", heading: [1, 0.3, 0]"))
    ball = simulate(
        task(
            "shape: sphere, radius: 200 mm, xyz: [500 mm, 0, 100 mm]",
            heading=", heading: [1, 0.3, 0]",
        )
    )
    body = read(str(parts / "ball.stl"), 0, "mm")
    below = 0.2 - body.offsets.min()
    assert 1e-4 < below < 1e-3
    tip = []
    for run in (mesh, ball):
        q = np.stack([run.during("wipe", f"joint.{i + 1}.position") for i in range(7)], axis=1)
        twin = run.program.context.robot.twin()
        tip.append(np.array([twin.tip(each).translation for each in q[::100]]))
    assert len(tip[0]) > 15
    np.testing.assert_allclose(tip[0], tip[1], atol=1.5 * below)
    # A facet leans by up to half of what it is off its neighbours, which the tool runs up and down.
    angles = trimesh.creation.icosphere(3).face_adjacency_angles
    force = mesh.during("wipe", "force.z", 0.5)
    assert np.mean(force) == pytest.approx(-20, abs=0.2)
    lean = mesh.during("wipe", "force.x", 0.5) / -force
    assert np.mean(lean) == pytest.approx(0.2, abs=0.02)
    assert np.max(np.abs(lean - 0.2)) < 0.75 * angles.max()


def test_distances_of_a_mesh_are_those_of_the_box():
    """Facets, edges and corners, from outside and from within."""
    edges = (0.3, 0.2, 0.06)
    made = trimesh.creation.box(edges)
    mesh = Mesh(np.zeros(3), np.eye(3), convex_body(made.vertices, made.faces))
    box, x = Box(np.zeros(3), np.eye(3), edges), ca.SX.sym("x", 3)
    at = ca.Function("at", [x], [mesh.height(x), box.height(x)])
    rng = np.random.default_rng(1)
    for point in rng.uniform(-0.25, 0.25, (2000, 3)):
        one, other = map(float, at(point))
        assert one == pytest.approx(other, abs=1e-9)


def test_a_mesh_has_smooth_parts():
    """Six of a box, three of a drum, one of a ball: its normals are off by 1 of 4 deg."""

    def parts_of(mesh):
        return convex_body(np.asarray(mesh.vertices), np.asarray(mesh.faces))

    assert parts_of(trimesh.creation.box((0.3, 0.2, 0.1))).parts.max() == 5
    assert parts_of(trimesh.creation.cylinder(0.1, 0.3, sections=48)).parts.max() == 2
    body = parts_of(trimesh.creation.icosphere(3, radius=0.2))
    assert body.parts.max() == 0
    mesh, ball = Mesh(np.zeros(3), np.eye(3), body), Sphere(np.zeros(3), np.eye(3), 0.2)
    rng = np.random.default_rng(4)
    for _ in range(20):
        x = rng.normal(size=3)
        x *= 0.21 / np.linalg.norm(x)
        one, other = (
            np.array(ca.evalf(chart_at(each, x).normal(ca.SX(x)))).ravel() for each in (mesh, ball)
        )
        assert math.degrees(math.acos(min(float(one @ other), 1.0))) < 1.0


def test_what_a_frame_goes_by_near_a_point_is_the_chart_there():
    """Value and slope of the normal, of which a tick takes no more."""
    body = convex_body(*(np.asarray(a) for a in _ico()))
    mesh = Mesh(np.array([0.1, 0.2, 0.3]), np.eye(3), body)
    x = np.array([0.16, 0.2, 0.5])
    chart = chart_at(mesh, x)
    near = chart.near(ca.SX(ca.DM(np.array(ca.evalf(chart.numbers(ca.SX(x)))))))
    for d in (np.zeros(3), *np.eye(3) * 1e-6):
        for of in ("normal", "foot"):
            one, other = (
                np.array(ca.evalf(getattr(each, of)(ca.SX(x + d)))).ravel()
                for each in (chart, near)
            )
            # Off the facet's plane the foot differs along the normal, which no coordinate counts.
            n = np.array(ca.evalf(chart.normal(ca.SX(x)))).ravel()
            off = (one - other) - (n @ (one - other) * n if of == "foot" else 0)
            assert np.linalg.norm(off) < 1e-9


def _ico():
    mesh = trimesh.creation.icosphere(2, radius=0.2)
    return mesh.vertices, mesh.faces


@pytest.mark.parametrize("file", ["block.obj", "ascii.stl"])
def test_all_kinds_of_file_hold_the_same_body(parts, file):
    one, other = (read(str(parts / name), 0, "mm") for name in ("block.stl", file))
    assert sorted(map(tuple, np.round(one.corners, 9).tolist())) == sorted(
        map(tuple, np.round(other.corners, 9).tolist())
    )
    assert len(one.normals) == len(other.normals) == 6


@pytest.mark.parametrize("unit", list(UNITS))
def test_the_unit_is_what_the_numbers_are_in(parts, unit):
    body = read(str(parts / "block.stl"), 0, unit)
    assert np.ptp(body.corners[:, 0]) == pytest.approx(300 * UNITS[unit])


@pytest.mark.parametrize(("file", "words"), [
    # The wall of a bore of 20 mm in a ring of 50 mm: 84 % of the disc is there.
    ("ring.stl", r"not convex: its surface lies up to 15 mm below its convex hull.* 84 % of"),
    ("open.stl", "not closed: 3 of its edges do not join two triangles"),
    ("flat.stl", "no volume"),
    ("fine.stl", "5120 facets, more than 1500"),
    ("none.stl", "cannot be read|no triangles"),
    ("garbage.obj", "cannot be read|no triangles"),
])  # fmt: skip
def test_what_cannot_be_touched_is_refused_with_its_numbers(parts, file, words):
    with pytest.raises(MeshError, match=words) as refused:
        read(str(parts / file), 0, "mm")
    assert refused.value.hint


def test_a_file_is_found_from_the_file_that_names_it_and_below_the_project_alone(parts, tmp_path):
    """In an included file from there; elsewhere than in the project it is TS409 at its name."""
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "Block.STL").write_bytes((parts / "block.stl").read_bytes())
    world = f"world:\n  thing: {{{_mesh(Path(), 'Block.STL')}}}\n"
    (tmp_path / "cell" / "world.yaml").write_text(world)
    rest = "robot: {model: panda}\nstages: {go: {time: 1 s}}\n"
    (tmp_path / "task.yaml").write_text(f"taskspec: 1\ninclude: cell/world.yaml\n{rest}")
    loaded = load_task(tmp_path / "task.yaml")
    assert surface(loaded.task.shapes["thing"]).body.parts.max() == 5
    assert tmp_path / "cell" / "Block.STL" in loaded.included
    outside = world.replace("Block.STL", "../block.stl")
    (tmp_path / "task.yaml").write_text(f"taskspec: 1\n{outside}{rest}")
    with pytest.raises(SpecError) as refused:
        load_task(tmp_path / "task.yaml")
    (only,) = refused.value.diagnostics
    assert (only.code, only.span.line) == ("TS409", 3)
