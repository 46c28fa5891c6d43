"""Moving surfaces: contact sees where they are and how fast they go."""

from __future__ import annotations

import numpy as np
import pytest

from plants import Pushed
from taskspec.geometry.rotation import from_rpy
from taskspec.program.world.moving_base import moving_bases

TABLE = "table: {{shape: plane, xyz: [0, 0, 399 mm], stiffness: 20 kN/m, {more}}}"


def table(more: str, damping: float = 20.0) -> Pushed:
    return Pushed(TABLE.format(more=more), damping=damping)


def logged(pushed: Pushed, force: list[float], seconds: float, spring: float = 500.0) -> np.ndarray:
    """Rows of clock, tip (3,) and wrench (6,) of every step, by the environment on the tool."""
    rows = []
    for _ in range(round(seconds * 1000)):
        clock = pushed.data.time
        pushed.push(force, 1e-3, spring=spring)
        rows.append([clock, *pushed.tip, *pushed.plant.arm.wrench])
    return np.array(rows).T


def test_a_vibrating_plane_presses_with_stiffness_times_depth():
    w = 2 * np.pi * 3
    pushed = table("damping: 0 N*s/m, motion: {z: 0.5 mm * sin(clock * 18.849556 rad/s)}")
    rows = logged(pushed, [0, 0, -30.0], 1.5)[:, 1000:]
    clock, z, force = rows[0], rows[3], rows[6]
    depth = 0.399 + 0.5e-3 * np.sin(w * clock) - z
    # The contact's virtual mass, 2 % of some 2.5 kg, on a relative acceleration of at most
    # w^2 * 0.5 mm = 0.18 m/s^2 makes 9 mN.
    assert np.ptp(force) > 1.0
    assert np.min(force) > 5.0
    np.testing.assert_allclose(force, 20e3 * depth, atol=0.01)


@pytest.mark.parametrize("speed", [10, -50])
def test_a_conveyor_drags_with_coulombs_friction(speed):
    pushed = table(f"friction: 0.3, motion: {{x: {speed} mm/s * clock}}")
    # Stiff joints let the tip stand, so that the belt slides by at its own speed.
    rows = logged(pushed, [0, 0, -60.0], 1.5, spring=2000.0)[:, 1000:]
    normal, drag = rows[6], rows[4]
    assert np.min(normal) > 5.0
    np.testing.assert_allclose(drag / normal, 0.3 * np.sign(speed), rtol=0.01)
    np.testing.assert_allclose(rows[5] / normal, 0.0, atol=0.02)


def test_a_turntable_drags_across_its_radius():
    pushed = Pushed(
        "disc: {shape: cylinder, xyz: [400 mm, 0, 374 mm], radius: 200 mm, length: 50 mm, "
        "friction: 0.3, motion: {rz: 1 rad/s * clock}}",
        damping=20.0,
    )
    rows = logged(pushed, [0, 0, -30.0], 1.0)[:, 700:]
    assert np.min(rows[6]) > 5.0
    # The rim moves at 0.1 m/s along +y where the tool is.
    np.testing.assert_allclose(rows[5] / rows[6], 0.3, rtol=0.01)


def test_driven_coordinates_are_where_the_clock_has_them():
    """Nothing that touches them moves them, and their axes are their own."""
    motion = (
        "motion: {x: 10 mm * sin(clock * 5 rad/s), z: 1 mm * sin(clock * 9 rad/s), "
        "ry: 0.01 rad * sin(clock * 7 rad/s)}"
    )
    pushed = table("rpy: [0, 0, 90 deg], friction: 0.3, " + motion)
    rows = logged(pushed, [0, 0, -30.0], 1.0)
    data, model = pushed.data, pushed.model
    clock = rows[0][-1]
    assert np.min(rows[6, 500:]) > 5.0
    body = model.body("world/table").id
    turn = 0.01 * np.sin(7 * clock)
    np.testing.assert_allclose(
        data.xpos[body],
        [0.0, 0.01 * np.sin(5 * clock), 0.399 + 0.001 * np.sin(9 * clock)],
        atol=1e-12,
    )
    # Its own y points along the world's -x: z leans towards its own x, the world's y.
    np.testing.assert_allclose(
        data.xmat[body].reshape(3, 3)[:, 2], [0.0, np.sin(turn), np.cos(turn)], atol=1e-12
    )
    # The controller has the same motion.
    A, a = moving_bases(pushed.task)["table"].pose(clock)
    np.testing.assert_allclose(data.xpos[body], A @ [0.0, 0.0, 0.399] + a, atol=1e-12)
    declared = from_rpy((0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(data.xmat[body].reshape(3, 3), A @ declared, atol=1e-12)
    # At the step's end it is off by the step's own error, a T^2/2 at the most.
    place = data.qpos[model.joint("world/table/x").qposadr[0]]
    assert place == pytest.approx(0.01 * np.sin(5 * data.time), abs=0.5 * 0.25 * 1e-6)


def test_an_arm_far_from_what_moves_does_not_feel_it():
    still = Pushed("", damping=1.0)
    beside = Pushed(
        "far: {shape: box, xyz: [2 m, 0, 0], size: [1 m, 1 m, 100 mm], "
        "motion: {z: 100 mm * sin(clock * 9 rad/s)}}",
        damping=1.0,
    )
    for pushed in (still, beside):
        pushed.push([3.0, 4.0, 5.0], 0.2)
    np.testing.assert_allclose(still.plant.arm.q, beside.plant.arm.q, atol=1e-13)
