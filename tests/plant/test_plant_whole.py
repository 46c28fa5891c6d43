"""Whole surfaces: the declared stiffness at every tilt, friction, and insertion in closed form."""

from __future__ import annotations

import ctypes
import math

import casadi as ca
import mujoco
import numpy as np
import pytest

from insertion_rig import (
    IMPEDANCE,
    PEG,
    PEGS,
    SOLIDS,
    R,
    Rig,
    chamfer,
    press,
    press_on,
    thrown,
    two_points,
    wedged,
)
from taskspec.native.engine import Engine
from taskspec.native.kernel import vector
from taskspec.native.kernel_ir import kernel_ir
from taskspec.shapes import SHAPES, overlap, patches
from taskspec_runner.errors import InputError
from taskspec_runner.plant import simulator
from taskspec_runner.plant.simulator import LayoutError
from taskspec_runner.plant.whole import collision, contacts, markers

INSERT = """
taskspec: 1
name: insert
robot:
  model: panda
  tool: {shape: TOOL, length: 140 mm, mass: 300 g}
  start: {xyz: [500.8 mm, 0, 303 mm]}
world:
  plate: {SHAPE, depth: 15 mm, xyz: [500 mm, 0, 300 mm], stiffness: 100 kN/m,
    damping: 200 N*s/m, friction: 0.2}
law: impedance
stages:
  insert:
    axes: {x: {stiffness: 2 kN/m}, z: {velocity: -30 mm/s, stiffness: 2 kN/m}}
    until: travel > 12 mm
    within: {time: 2 s}
expect: [plate.force < 200 N]
"""


@pytest.mark.parametrize("tilt", [0.0, 1e-3, 0.3, 45.0, 89.9, 90.0, 95.0])
@pytest.mark.parametrize("stiffness", [2e3, 200e3])
@pytest.mark.parametrize("tool", list(PEGS))
def test_faces_edges_sides_and_points_bear_the_declared_stiffness(tool, stiffness, tilt):
    assert press(patches.PLATE, (), tool, stiffness, math.radians(tilt)) == pytest.approx(
        1.0, rel=1e-6
    )


@pytest.mark.parametrize("tilt", [0.0, 0.01, 0.3, 45.0, 90.0])
@pytest.mark.parametrize("tool", list(PEGS))
@pytest.mark.parametrize("solid", list(SOLIDS))
def test_solids_bear_the_declared_stiffness(solid, tool, tilt):
    """Up to 3e-6: a tool that leans on a line or a point turns the normal as it is pressed."""
    assert press_on(solid, tool, 20e3, math.radians(tilt)) == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize("aside", [0.0, 0.045, 0.055])
def test_a_face_that_hangs_over_the_edge_of_a_box_bears_the_declared_stiffness(aside):
    assert press_on("box", "cylinder", 20e3, 0.0, aside) == pytest.approx(1.0, rel=1e-5)


@pytest.mark.parametrize("tool", list(PEGS))
@pytest.mark.parametrize("solid", list(SOLIDS))
def test_a_contact_without_friction_and_damping_gives_back_what_it_takes(solid, tool):
    """Up to a part of the simulator's virtual mass of 2 %, whose normal turns in the meantime."""
    for seed in range(3):
        assert thrown(solid, tool, seed) == pytest.approx(1.0, abs=0.25 * IMPEDANCE)


@pytest.mark.parametrize("tool", [overlap.CYLINDER, overlap.BOX])
@pytest.mark.parametrize("body", [overlap.BALL, overlap.CYLINDER, overlap.BOX])
def test_depth_is_the_shortest_way_apart(body, tool):
    """No direction of a thousand parts both sooner, and the normal's support points are in line."""
    rng, eps = np.random.default_rng(7), 5e-6
    ways = rng.normal(size=(1000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    deep = 0
    for _ in range(12):
        solids = []
        for kind, center in ((tool, rng.normal(size=3) * 0.025), (body, np.zeros(3))):
            axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            half = rng.uniform(0.01, 0.03, 3)
            half = half[{overlap.BALL: [0, 0, 0], overlap.CYLINDER: [0, 0, 2]}.get(kind, [0, 1, 2])]
            solids.append(np.array([*center, *axes.T.ravel(), kind, *half, eps]))
        t, b = solids
        work, at, shift = np.zeros(overlap.WORK), np.zeros(4), sum(overlap.bulge(s) for s in solids)
        # They are brought to where presses are: not through each other.
        depth = overlap.overlap(vector(t), vector(b), math.inf, vector(work))
        t[:3] += (depth - rng.uniform(-0.002, 0.003)) * work[:3]
        depth = overlap.overlap(vector(t), vector(b), math.inf, vector(work))
        n = work[:3].copy()
        deep += depth > 0

        def along(u, t=t, b=b, at=at):
            tools = overlap.support(vector(t), *(-u).tolist(), vector(at))
            return tools + overlap.support(vector(b), *u.tolist(), vector(at))

        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
        assert depth == pytest.approx(along(n) - shift, abs=1e-12)
        # Rounded faces may have neighbouring minima, which differ by less than the rounding.
        assert depth <= min(along(u) for u in ways) - shift + eps
    assert 3 <= deep <= 11


@pytest.mark.parametrize(
    ("kind", "sizes", "tool", "expected"),
    [
        (patches.HOLE, (R, 0.02, 0.001), "cylinder", 1.0),
        (patches.HOLE, (R, 0.02, 0.0), "sphere", 1.0),
        (patches.SLOT, (0.021, 0.02, 0.001), "box", 1.0),
        (patches.SLOT, (0.010, 0.02, 0.0), "box", 1.0),
        # Two flanks, each with the declared stiffness along its normal.
        (patches.GROOVE, (math.radians(90), 0.02), "sphere", 1.0),
        (patches.GROOVE, (math.radians(60), 0.03), "sphere", 0.5),
    ],
)
def test_stiffness_of_what_is_cut(kind, sizes, tool, expected):
    """Bottom of a hole and a slot, the plate on both sides of a slot, two flanks of a groove."""
    assert press(kind, sizes, tool, 50e3, 0.0) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("tilt", [0.0, 10.0, 90.0])
@pytest.mark.parametrize("on", ["plate", "box"])
def test_faces_edges_and_sides_slide_with_the_declared_friction(on, tilt):
    kind, sizes, at = patches.PLATE, (), (0.0, 0.0, 0.0)
    if on == "box":
        kind, sizes, at = overlap.BOX, (1.0, 0.1, 0.1, 5e-6), (0.9, 0.0, -0.1)
    rig = Rig(
        kind, sizes, PEGS["cylinder"], joints="xz", friction=0.3, tilt=math.radians(tilt),
        height=0.011 if tilt == 90 else 0.002, dampers={"z": 200.0, "x": 100.0}, at=at,
    )  # fmt: skip
    rig.data.qfrc_applied[:] = [12.0, -20.0]
    rig.step(3000)
    force = rig.force()
    assert rig.data.qvel[0] > 0.01
    assert -force[0] / force[2] == pytest.approx(0.3, rel=1e-2)


@pytest.mark.parametrize("side", [-4.0, 0.0, 4.0])
@pytest.mark.parametrize("depth", [0.012, 0.03])
def test_jamming(depth, side):
    """Statics of two points is met within 0.2 %, Whitney's line, of small tilts, within 5 %."""
    measured, statics, whitney = two_points(0.3, depth, 0.15, side)
    assert measured == pytest.approx(statics, rel=2e-3)
    assert measured == pytest.approx(whitney, rel=5e-2)


@pytest.mark.parametrize(("ratio", "stays"), [(0.6, True), (0.95, True), (1.05, False), (2, False)])
def test_a_peg_wedges_at_less_than_friction_times_diameter(ratio, stays):
    assert (wedged(0.4, ratio) > 0.2) == stays


@pytest.mark.parametrize("friction", [0.0, 0.2])
@pytest.mark.parametrize("stiffness", [20e3, 200e3])
def test_chamfer_crossing(stiffness, friction):
    measured, expected = chamfer(friction, stiffness, 0.0022)
    np.testing.assert_allclose(measured, expected, rtol=2e-3)


@pytest.mark.parametrize("depth", [0.01, 0.03])
def test_two_point_angle(depth):
    """D = d cos a + l sin a, D wider by what both walls yield."""
    rig = Rig(
        patches.HOLE, (R, 0.06, 0.0), PEGS["cylinder"], springs={"x": 1.0},
        dampers={"x": 50.0, "b": 0.5, "z": 10.0}, joints="xb", height=-depth,
    )  # fmt: skip
    rig.data.qfrc_applied[1] = 0.02
    rig.step(6000)
    forces = rig.forces()
    assert len(forces) == 2
    angle = abs(float(rig.data.qpos[1]))
    yielding = sum(float(np.linalg.norm(f)) for _, _, f in forces) / 200e3
    low = max(-float(place[2]) for place, _, _ in forces)
    reach = 2 * PEG * math.cos(angle) + low * math.sin(angle)
    assert 2 * R + yielding == pytest.approx(reach, rel=1e-3)


def test_a_peg_rests_on_the_plate_beside_its_hole():
    """Of a face that hangs over the bore the centre of pressure is under the load, and k is k."""
    rig = Rig(
        patches.HOLE, (R, 0.03, 0.0), PEGS["cylinder"], joints="zb", height=0.0005,
        dampers={"z": 200.0, "b": 0.5}, springs={"x": 1.0},
    )  # fmt: skip
    rig.model.body_pos[1][0] = 0.006
    rig.data.qfrc_applied[0] = -20.0
    rig.step(4000)
    (place, normal, force), *_ = rig.forces()
    assert place[0] == pytest.approx(0.006, abs=1e-5)
    np.testing.assert_allclose(normal, [0, 0, 1], atol=1e-6)
    assert force[2] == pytest.approx(20.0, rel=1e-6)
    assert abs(float(rig.data.qpos[1])) < 1e-4


@pytest.mark.parametrize("height", [0.0015, 0.0005, 1e-6, -1e-6, -0.0005])
def test_a_leaning_peg_meets_the_edge_that_it_leans_over(height):
    """Also while the middle of its end is above the plate, without a jump where that goes below.

    With the tip at x, at a height h, the edge at R is r - (R - x) cos(t) - h sin(t) deep in the
    side; a lateral force F makes that F/(k cos(t)).
    """
    tilt, force, stiffness = math.radians(15.0), 5.0, 200e3
    rig = Rig(
        patches.HOLE, (R, 0.025, 0.0), PEGS["cylinder"], joints="x", stiffness=stiffness,
        tilt=tilt, height=height, dampers={"x": 2000.0},
    )  # fmt: skip
    rig.data.qfrc_applied[0] = force
    rig.step(4000)
    c, s = math.cos(tilt), math.sin(tilt)
    deep = PEG - height * s - force / (stiffness * c)
    assert rig.data.ncon == 1
    assert rig.data.qpos[0] == pytest.approx(R - deep / c, abs=2e-7)
    assert rig.data.contact[0].frame[:3] == pytest.approx([-c, 0.0, s], abs=1e-6)


def _random(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    kind, sizes = [
        (patches.PLATE, ()),
        (patches.HOLE, (R, 0.03, 0.001)),
        (patches.HOLE, (R, 0.03, 0.0)),
        (patches.SLOT, (0.02, 0.03, 0.001)),
        (patches.GROOVE, (1.2, 0.02)),
        (patches.HOLE, (R, 0.03, 0.001, 0.03, 0.025, 0.04)),
        (patches.SLOT, (0.02, 0.03, 0.001, 0.022)),
        (patches.GROOVE, (1.2, 0.02, 0.03)),
        (overlap.BOX, (0.03, 0.02, 0.01, 5e-6)),
        (overlap.CYLINDER, (0.02, 0.02, 0.01, 5e-6)),
        (overlap.BALL, (0.02, 0.02, 0.02, 5e-6)),
    ][rng.integers(11)]
    tool = list(PEGS.values())[rng.integers(3)]
    turn = rng.normal(size=3) * 0.1
    angle = float(np.linalg.norm(turn))
    quaternion, axes = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quaternion, turn / angle, angle)
    mujoco.mju_quat2Mat(axes, quaternion)
    axes = axes.reshape(3, 3) @ np.diag([1.0, -1.0, -1.0])
    place = np.array([0, 0, 0, *(rng.normal(size=2) * 0.003), rng.uniform(-0.02, 0.03)])
    data = np.zeros((2, contacts.DATA))
    padded = [*sizes, *([0.0] * (6 - len(sizes)))]
    data[0, :14] = [contacts.SHAPE, kind, *padded, 2e4, 40, 0.2, 0.5, 10, IMPEDANCE]
    data[1, :6] = [contacts.TOOL, tool[0], *tool[1], 5e-6]
    return place, np.concatenate([np.eye(3).ravel(), axes.ravel()]), data


def test_machine_code_has_the_bits_of_python():
    engine = Engine([kernel_ir(contacts.touch)], level=2)
    p, i = ctypes.c_void_p, ctypes.c_int64
    code = engine.function("touch", i, p, p, p, i, i, i, p, p, p)
    rng = np.random.default_rng(5)
    touched = 0
    for _ in range(1000):
        world = _random(rng)
        made, work = np.zeros((2, contacts.CONTACT * patches.MOST)), np.zeros(contacts.WORK)
        addresses = [a.ctypes.data for a in world]
        at = made[0].ctypes.data
        n = code(*addresses, contacts.DATA, 1, 0, at, at, work.ctypes.data)
        memory = memoryview(made[1]).cast("B")
        place, axes, data = (vector(a) for a in world)
        m = contacts.touch(
            place, axes, data, contacts.DATA, 1, 0, memory.cast("d"), memory.cast("i"),
            vector(work),
        )  # fmt: skip
        assert n == m
        assert made[0].tobytes() == made[1].tobytes()
        touched += n > 0
    assert touched > 300


#: A bore around the edges of the box of `PEGS`, with 0.1 mm of room.
BOX_R = math.hypot(0.0095, 0.0099) + 1e-4


@pytest.mark.parametrize("chamfer", [0.0, 0.001])
@pytest.mark.parametrize("depth", [0.005, 0.02])
def test_a_box_touches_a_round_wall_with_two_of_its_edges(chamfer, depth):
    """Pushed along x, each of two edges bears k D along the wall's normal: F = 2 k D dD/dx."""
    rig = Rig(
        patches.HOLE, (BOX_R, 0.09, chamfer), PEGS["box"], joints="x", stiffness=50e3,
        height=-depth, dampers={"x": 200.0},
    )  # fmt: skip
    for force in (20.0, 40.0):
        rig.data.qfrc_applied[:] = force
        rig.step(4000)
        assert rig.data.ncon == 2
        x = 0.0095 + float(rig.data.qpos[0])
        far = math.hypot(x, 0.0099)
        assert 2 * 50e3 * (far - BOX_R) * x / far == pytest.approx(force, rel=0.01)


@pytest.mark.parametrize(("aside", "expected"), [(0.0, 1.0), (0.004, 1.0)])
def test_a_box_that_is_wider_than_the_hole_rests_on_the_plate(aside, expected):
    rig = Rig(
        patches.HOLE, (0.008, 0.03, 0.0), PEGS["box"], joints="z", stiffness=50e3,
        dampers={"z": 400.0},
    )  # fmt: skip
    rig.model.body_pos[1][0] = aside
    depths = []
    for force in (20.0, 40.0):
        rig.data.qfrc_applied[:] = -force
        rig.step(6000)
        depths.append(float(rig.data.qpos[0]))
    assert 20.0 / (depths[0] - depths[1]) == pytest.approx(expected * 50e3, rel=2e-3)


def test_a_box_goes_into_a_hole_that_its_edges_fit_and_stands_on_its_bottom():
    rig = Rig(
        patches.HOLE, (BOX_R, 0.02, 0.001), PEGS["box"], joints="xz", stiffness=50e3,
        height=0.001, dampers={"x": 50.0, "z": 200.0},
    )  # fmt: skip
    rig.data.qpos[0] = 0.0006
    rig.data.qfrc_applied[:] = [0.0, -20.0]
    rig.step(4000)
    assert 0.001 + rig.data.qpos[1] == pytest.approx(-0.02 - 20.0 / 50e3, abs=1e-5)
    assert abs(rig.data.qpos[0]) < 3e-4


def test_a_tilted_box_touches_at_two_places_on_opposite_sides():
    rig = Rig(
        patches.HOLE, (BOX_R, 0.09, 0.0), PEGS["box"], joints="xb", stiffness=200e3, height=-0.03,
        dampers={"x": 50.0, "b": 0.5},
    )  # fmt: skip
    rig.data.qfrc_applied[:] = [0.0, 0.1]
    rig.step(6000)
    places = np.array([place for place, _, _ in rig.forces()])
    assert len(places) == 4
    assert sorted(np.sign(places[:, 0])) == [-1, -1, 1, 1]
    assert np.ptp(places[:, 2]) == pytest.approx(0.03, abs=5e-4)
    # Both ends have the room of x, 2 (sqrt(R^2 - y^2) - w), between them; each sinks in by 0.1 N m
    # over 30 mm, shared by two edges at 46 degrees, over k.
    room = 2 * (math.sqrt(BOX_R**2 - 0.0099**2) - 0.0095)
    sunk = 2 * 0.1 / 0.03 / (2 * 200e3 * 0.48)
    assert math.tan(float(rig.data.qpos[1])) * 0.03 == pytest.approx(room + sunk, rel=0.1)


BLOCK = (R, 0.02, 0.001, 0.06, 0.04, 0.03)


def _pushed(kind, sizes, tool, x, z, force):
    """Where a tool ends along x that is pushed along it by so many newtons, at a height."""
    rig = Rig(kind, sizes, PEGS[tool], joints="x", stiffness=50e3, height=z, dampers={"x": 200.0})
    rig.model.body_pos[1][0] = x
    rig.data.qfrc_applied[:] = force
    rig.step(4000)
    return x + float(rig.data.qpos[0]), rig


@pytest.mark.parametrize(
    ("tool", "half"), [("cylinder", 0.0099), ("box", 0.0095), ("sphere", 0.0099)]
)
@pytest.mark.parametrize("towards", [-1, 1])
@pytest.mark.parametrize(
    ("kind", "sizes", "z", "inner"),
    [
        (patches.SLOT, (0.021, 0.02, 0.001, 0.05), -0.01, True),
        (patches.SLOT, (0.021, 0.02, 0.0, 0.05), -0.001, True),
        (patches.HOLE, BLOCK, -0.02, False),
    ],
)  # fmt: skip
def test_the_end_of_a_slot_and_the_side_of_a_block_hold_a_tool(
    kind, sizes, z, inner, tool, half, towards
):
    """Flat against the wall, each newton over k deep; a ball needs its middle below the edge."""
    if tool == "sphere":
        z -= 0.01
    wall = sizes[3] / 2 - half if inner else -sizes[3] / 2 - half
    start = 0.0 if inner else -towards * (sizes[3] / 2 + half + 0.005)
    places = [_pushed(kind, sizes, tool, start, z, towards * force)[0] for force in (10.0, 20.0)]
    assert places[0] == pytest.approx(towards * (wall + 10.0 / 50e3), abs=2e-5)
    assert abs(places[1] - places[0]) == pytest.approx(10.0 / 50e3, rel=1e-3)


@pytest.mark.parametrize("tool", list(PEGS))
@pytest.mark.parametrize(("x", "y"), [(0.018, 0.0), (0.0, 0.014), (0.019, 0.012)])
def test_the_top_of_a_block_bears_the_declared_stiffness(tool, x, y):
    """Beside the bore, as far as its middle is over the top: also partly over the side."""
    depths = []
    rig = Rig(patches.HOLE, BLOCK, PEGS[tool], joints="z", stiffness=50e3, dampers={"z": 400.0})
    rig.model.body_pos[1][:2] = x, y
    for force in (20.0, 40.0):
        rig.data.qfrc_applied[:] = -force
        rig.step(6000)
        depths.append(float(rig.data.qpos[0]))
        (_, normal, _), *_ = rig.forces()
        np.testing.assert_allclose(normal, [0, 0, 1], atol=2e-2)
    assert 20.0 / (depths[0] - depths[1]) == pytest.approx(50e3, rel=2e-3)


@pytest.mark.parametrize("tool", list(PEGS))
def test_beside_and_below_a_block_there_is_nothing(tool):
    for x, z in ((0.0405, -0.02), (-0.0405, -0.005), (0.0, -0.095), (0.02, -0.095)):
        rig = Rig(patches.HOLE, BLOCK, PEGS[tool], joints="x")
        rig.model.body_pos[1][[0, 2]] = x, z
        rig.step(1)
        assert rig.data.ncon == 0, (x, z)


def test_a_peg_deep_in_the_bore_of_a_narrow_block_feels_the_bore():
    """The way out by the side would be shorter than that by the top."""
    rig = Rig(
        patches.HOLE, (R, 0.05, 0.0, 0.024, 0.024, 0.06), PEGS["cylinder"], joints="x",
        stiffness=50e3, height=-0.04, dampers={"x": 200.0},
    )  # fmt: skip
    rig.data.qfrc_applied[:] = 20.0
    rig.step(4000)
    assert float(rig.data.qpos[0]) == pytest.approx(R - 0.0099 + 20.0 / 50e3, abs=2e-5)


def test_a_ball_rolls_along_a_groove_up_to_its_end():
    half = math.radians(30)
    rig = Rig(
        patches.GROOVE, (2 * half, 0.02, 0.06), PEGS["sphere"], joints="xz", stiffness=50e3,
        dampers={"x": 20.0, "z": 200.0}, height=-0.009,
    )  # fmt: skip
    rig.data.qfrc_applied[:] = [5.0, -20.0]
    rig.step(4000)
    # The ball's centre is r/sin(half) over the groove's edge, less what it sinks in.
    centre = 0.0099 / math.sin(half) - 0.02 - 20.0 / (2 * 50e3 * math.sin(half) ** 2)
    assert rig.data.qpos[1] - 0.009 + 0.0099 == pytest.approx(centre, abs=5e-5)
    assert rig.data.qpos[0] == pytest.approx(0.03 - 0.0099 + 5.0 / 50e3, abs=2e-5)


@pytest.mark.parametrize(
    ("kind", "sizes", "of_plant"),
    [
        ("hole", {"radius": R, "depth": 0.02, "chamfer": 0.001, "size": (0.06, 0.04, 0.03)},
         (patches.HOLE, BLOCK)),
        ("slot", {"width": 0.02, "depth": 0.02, "chamfer": 0.001, "length": 0.05},
         (patches.SLOT, (0.02, 0.02, 0.001, 0.05))),
        ("groove", {"angle": 1.2, "depth": 0.02, "length": 0.05},
         (patches.GROOVE, (1.2, 0.02, 0.05))),
    ],
)  # fmt: skip
def test_a_small_ball_is_as_deep_as_the_distance_says(kind, sizes, of_plant):
    """The surface of the language and that of the plant are one, wherever a point is."""
    surface = SHAPES[kind](np.zeros(3), np.eye(3), **sizes)
    x = ca.SX.sym("x", 3)
    distance = ca.Function("distance", [x], [surface.distance(x)])
    rng, ball = np.random.default_rng(3), 0.0005
    tool = (overlap.BALL, (ball, ball, ball))
    rig = Rig(of_plant[0], of_plant[1], tool, joints="x", rounding=1e-9)
    touched = 0
    for _ in range(400):
        place = rng.uniform((-0.04, -0.03, -0.025), (0.04, 0.03, 0.002))
        # The rig's tool stands on its tip.
        rig.model.body_pos[1][:] = place - [0, 0, ball]
        mujoco.mj_forward(rig.model, rig.data)
        beyond = np.abs(place[:2]) - np.array(sizes.get("size", (1.0, 1.0)))[:2] / 2
        if beyond.min() > 0 and place[2] > 0:
            continue  # At a corner of three faces its edges stand for it.
        gap = float(distance(place)) - ball
        deepest = max((-c.dist for c in rig.data.contact), default=0.0)
        if gap > 1e-6:
            assert deepest < 1e-6, place
        elif gap > -ball:
            # From its surface inwards, as long as its middle is outside.
            assert deepest == pytest.approx(-gap, abs=2e-6), place
            touched += 1
    assert touched > 5


def test_a_collision_function_in_python_makes_the_same_run():
    table, at = collision._table(), collision._KIND * collision._KINDS + collision._KIND
    collision.install()
    states = []
    for python in (False, True):
        rig = Rig(
            patches.HOLE, (R, 0.03, 0.001), PEGS["cylinder"], friction=0.2, height=0.002,
            dampers={"x": 5.0, "z": 20.0, "b": 0.01}, springs={"x": 500.0},
        )  # fmt: skip
        rig.data.qpos[0], rig.data.qpos[2] = 0.0008, 0.01
        rig.data.qfrc_applied[1] = -5.0
        kept = table[at]
        if python:
            add = simulator.address("mj_addContact")
            table[at], _held = collision.interpreted(collision.layout(), add, kept)
        rig.step(200)
        table[at] = kept
        states.append((rig.data.qpos.tobytes(), rig.data.qvel.tobytes(), rig.data.ncon))
    assert states[0] == states[1]


def test_ellipsoids_without_a_mark_are_mujocos_own():
    collision.install()
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><geom type='ellipsoid' size='.1 .1 .1'/><body pos='0 0 .19'>"
        "<freejoint/><geom type='ellipsoid' size='.1 .1 .1'/></body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 1
    assert data.contact[0].dist == pytest.approx(-0.01, abs=1e-4)


@pytest.mark.parametrize(
    ("shape", "tool"),
    [
        ("shape: hole, radius: 10 mm, chamfer: 1 mm",
         "cylinder, radius: 9.9 mm, thickness: 30 mm"),
        ("shape: hole, radius: 10 mm, chamfer: 1 mm", "sphere, radius: 9.5 mm"),
        ("shape: hole, radius: 13.7 mm, chamfer: 1 mm", "box, size: [19 mm, 19.4 mm, 30 mm]"),
        ("shape: slot, width: 20 mm, chamfer: 1 mm, rpy: [0, 0, 90 deg]",
         "box, size: [19.8 mm, 30 mm, 30 mm]"),
        ("shape: slot, width: 20 mm, chamfer: 1 mm, rpy: [0, 0, 90 deg]",
         "cylinder, radius: 9.9 mm, thickness: 30 mm"),
        ("shape: groove, angle: 60 deg, rpy: [0, 0, 90 deg]", "sphere, radius: 5 mm"),
    ],
)  # fmt: skip
def test_an_arm_inserts(simulate, shape, tool):
    """Beside, over the chamfer: the tool is led in, and the walls hold it."""
    run = simulate(INSERT.replace("TOOL", tool).replace("SHAPE", shape))
    assert run["position.z"][-1] < 0.2915
    assert np.max(run["plate.force"]) > 1.0
    assert abs(run["position.x"][-1] - 0.5) < 8.1e-4


def test_a_mujoco_that_takes_contacts_otherwise_is_refused(monkeypatch, simulate):
    def other() -> None:
        raise LayoutError("MuJoCo 9 takes contacts otherwise")

    monkeypatch.setattr(markers.collision, "install", other)
    text = INSERT.replace("TOOL", "cylinder, radius: 9.9 mm")
    with pytest.raises(InputError, match="'plate' cannot be simulated here: MuJoCo 9 takes"):
        simulate(text.replace("SHAPE", "shape: hole, radius: 10 mm"))


@pytest.mark.parametrize(
    ("kind", "sizes", "tool"),
    [
        (patches.HOLE, (R, 0.09, 0.0), "cylinder"),
        (patches.HOLE, (R, 0.09, 0.001), "cylinder"),
        (patches.HOLE, (R, 0.09, 0.001), "sphere"),
    ],
)
@pytest.mark.parametrize("depth", [0.0115, 0.02])
def test_a_wall_bears_the_declared_stiffness(kind, sizes, tool, depth):
    """A peg along the wall of a bore is one patch, from where it is in it on."""
    rig = Rig(
        kind, sizes, PEGS[tool], joints="x", stiffness=50e3, height=-depth, dampers={"x": 200.0}
    )
    places = []
    for force in (20.0, 40.0):
        rig.data.qfrc_applied[:] = force
        rig.step(4000)
        places.append(float(rig.data.qpos[0]))
    assert 20.0 / (places[1] - places[0]) == pytest.approx(50e3, rel=1e-3)


TILTED = """
taskspec: 1
robot:
  model: panda
  tool: {{shape: cylinder, radius: 9.9 mm, length: 140 mm, mass: 200 g}}
  start: {{xyz: [500 mm, 0, 312 mm], rpy: [180 deg, {tilt} deg, 0]}}
world:
  cut: {{shape: slot, width: 20 mm, depth: 60 mm, xyz: [500 mm, 0, 300 mm], rpy: [0, 0, 90 deg],
         stiffness: 100 kN/m}}
frame: world
law: impedance
stages:
  down: {{axes: {{z: {{move: -42 mm}}}}}}
"""


@pytest.mark.parametrize("tilt", [0, 15])
def test_a_tool_is_its_cylinder_over_its_whole_length(simulate, tilt):
    """30 mm deep, 19.8 mm that lean by 15 deg are 8 mm wider than the 20 mm between the walls."""
    run = simulate(TILTED.format(tilt=tilt))
    deep = 300.0 - 1e3 * float(run["position.z"][-1])
    largest = max(np.abs(run[f"force.{axis}"]).max() for axis in "xyz")
    if tilt:
        # It wedges where a diameter that leans spans the cut: R(1/cos - 1) at each wall, and it has
        # what the walls yield to go on by.
        assert largest > 10
        assert deep < 25
    else:
        assert largest < 1
        assert deep == pytest.approx(30, abs=0.1)
