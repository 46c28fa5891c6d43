"""Loose bodies: they rest, slide, are pushed and lifted."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from plants import Pushed

TABLE = "table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m, friction: 0.2}"
G = 9.81


def body(shape: str, more: str = "", z: str = "325 mm") -> str:
    return f"thing: {{{shape}, xyz: [500 mm, 200 mm, {z}], free: true, mass: 1.5 kg, {more}}}"


BOX = "shape: box, size: [60 mm, 40 mm, 50 mm]"
CYLINDER = "shape: cylinder, radius: 30 mm, length: 50 mm"
SPHERE = "shape: sphere, radius: 25 mm"


def rest(pushed: Pushed, seconds: float = 1.5) -> np.ndarray:
    """(7 bodies,) poses once everything has come to rest."""
    pushed.push(0.0, seconds, spring=100.0)
    pushed.plant._read_state()
    return pushed.plant.views.loose


@pytest.mark.parametrize("shape", [BOX, CYLINDER, SPHERE])
@pytest.mark.parametrize("stiff", ["stiffness: 1 kN/m", "stiffness: rigid"])
def test_a_resting_body_sinks_by_its_weight_over_the_tables_stiffness(shape, stiff):
    pose = rest(Pushed(f"{TABLE}, {body(shape, stiff)}", damping=20.0))
    assert 0.325 - pose[2] == pytest.approx(1.5 * G / 10e3, rel=1e-3)
    np.testing.assert_allclose(pose[3:], [1, 0, 0, 0], atol=1e-6)


def test_a_body_on_a_rigid_table_rests_where_the_steps_allow():
    table = TABLE.replace("10 kN/m", "rigid")
    pose = rest(Pushed(f"{table}, {body(BOX)}", damping=20.0))
    # `rigid` is half a radian in a step for the body's own mass.
    assert 0.325 - pose[2] == pytest.approx(G * (1e-3 / 0.5) ** 2, rel=1e-3)


def test_a_body_on_a_body_has_the_softer_ones_stiffness():
    on = "upper: {shape: box, size: [40 mm, 30 mm, 50 mm], xyz: [500 mm, 200 mm, 375 mm], "
    lower = body(BOX, "stiffness: 5 kN/m")
    for own, k in (("20 kN/m", 5e3), ("4 kN/m", 4e3)):
        upper = on + f"free: true, mass: 1 kg, stiffness: {own}}}"
        pose = rest(Pushed(f"{TABLE}, {lower}, {upper}", damping=20.0), 3.0)
        assert 0.325 - pose[2] == pytest.approx(2.5 * G / 10e3, rel=1e-3)
        assert 0.05 - (pose[9] - pose[2]) == pytest.approx(G / k, rel=1e-3)


def test_many_bodies_are_solved_densely_and_rest_with_their_weight():
    """MuJoCo 4.0.0's sparse Newton solver, which it would take from 60 degrees on, is wrong."""
    shape = "shape: box, size: [30 mm, 30 mm, 50 mm], stiffness: 20 kN/m"
    rows = [(x, y) for x in (400, 440, 480, 520) for y in (200, 240, 280)]
    boxes = ", ".join(
        f"b{i}: {{{shape}, xyz: [{x} mm, {y} mm, 325 mm], free: true, mass: 1 kg}}"
        for i, (x, y) in enumerate(rows)
    )
    pushed = Pushed(f"{TABLE}, {boxes}", damping=20.0)
    assert pushed.model.nv == 7 + 6 * len(rows) >= 60
    assert not mujoco.mj_isSparse(pushed.model)
    poses = rest(pushed).reshape(len(rows), 7)
    # Each stands on the table by itself, as deep as one alone does.
    assert 0.325 - poses[:, 2] == pytest.approx(np.full(len(rows), G / 10e3), rel=1e-3)
    # The joints that carry the arm push nothing: what the contacts bear is the boxes' weight.
    world = pushed.data.qfrc_constraint[7:].reshape(len(rows), 6)[:, 2]
    assert world == pytest.approx(np.full(len(rows), G), rel=1e-3)


def test_a_sliding_body_is_braked_by_coulombs_friction():
    pushed = Pushed(f"{TABLE}, {body(BOX)}", damping=20.0)
    rest(pushed)
    pushed.data.qvel[7] = 0.3
    pushed.push(0.0, 0.1, spring=100.0)
    assert pushed.data.qvel[7] == pytest.approx(0.3 - 0.2 * G * 0.1, rel=0.01)


def test_a_moving_table_takes_a_body_along():
    table = TABLE.replace("friction: 0.2", "friction: 0.5, motion: {x: 50 mm/s * clock}")
    pushed = Pushed(f"{table}, {body(BOX)}", damping=20.0)
    rest(pushed, 1.0)
    assert pushed.data.qvel[7] == pytest.approx(0.05, rel=1e-3)


def test_the_tool_pushes_with_the_bodys_own_stiffness():
    """A ball-ended tool on a box that lies below it: two springs in a row."""
    under = "xyz: [500 mm, 0, 374 mm], free: true, mass: 1.5 kg, stiffness: 4 kN/m"
    table = TABLE.replace("300 mm", "349 mm")
    pushed = Pushed(f"{table}, thing: {{{BOX}, {under}}}", damping=20.0)
    pushed.push([0, 0, -20.0], 2.0, spring=300.0)
    pushed.plant._read_state()
    force = pushed.plant.arm.wrench[2]
    assert force > 5.0
    assert pushed.plant.arm.object_forces[0] == 0.0
    assert pushed.plant.arm.object_forces[1] == pytest.approx(
        np.linalg.norm(pushed.plant.arm.wrench[:3])
    )
    pose = pushed.plant.views.loose
    assert 0.374 - pose[2] == pytest.approx((1.5 * G + force) / 10e3, rel=1e-3)
    assert pose[2] + 0.025 - pushed.tip[2] == pytest.approx(force / 4e3, rel=1e-3)


def test_inertia_is_uniform_and_free_flight_is_free():
    pushed = Pushed(body(BOX, z="3 m"))
    inertia = pushed.model.body_inertia[pushed.model.body("world/thing").id]
    expected = 1.5 / 12 * np.array([0.04**2 + 0.05**2, 0.06**2 + 0.05**2, 0.06**2 + 0.04**2])
    np.testing.assert_allclose(inertia, expected, rtol=1e-12)
    pushed.push(0.0, 0.2)
    assert pushed.data.qvel[9] == pytest.approx(-G * 0.2, rel=1e-9)
