"""Worlds of `vary` about the truth: the same everywhere, and distributed as they are said to be."""

from __future__ import annotations

import hashlib
import math
from statistics import NormalDist

import numpy as np
import pytest

from taskspec.compiler import compile_task
from taskspec.program.worlds import (
    corner_count,
    corner_world,
    deviations,
    draws_of,
    grid_count,
    grid_world,
    random_world,
    true_world,
    world_from,
)
from taskspec.spec import load_text
from taskspec_runner.loop.assembly import assemble

HEAD = """taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 310 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], friction: 0.1}, wall: {shape: plane}}
frame: table
stages: {wait: {axes: {z: {velocity: 0}}, time: 10 ms}}
"""


def context(rest: str):
    return compile_task(load_text(HEAD + rest, "task.yaml")).context


def test_a_world_is_the_same_however_many_and_whatever_else_varies():
    one = context("vary: {world.table.stiffness: 5..80 kN/m}\n")
    two = context(
        "vary: {world.wall.friction: 0..1, world.table.stiffness: 5..80 kN/m, robot.tool.mass: "
        "0..100 g}\n"
    )
    key = ("world.table.stiffness", None)
    for number in (7, 0, 100_000, 3):
        worlds = [random_world(each, 5, number) for each in (one, two)]
        assert worlds[0].values[key] == worlds[1].values[key]
        assert worlds[0].noise_seed == worlds[1].noise_seed
    assert random_world(one, 5, 1).values != random_world(one, 6, 1).values
    assert random_world(one, 5, 1).values != random_world(one, 5, 2).values
    # What a world is written down as makes it again.
    world = random_world(two, 5, 9)
    again = world_from(two, world.as_data(), 5)
    assert (again.values, again.noise_seed, again.task) == (
        world.values,
        world.noise_seed,
        world.task,
    )


def philox(key: int, counter: int) -> int:
    """The first word of Philox 4x64-10 (Salmon et al., 2011), in Python's own integers."""
    word = (1 << 64) - 1
    k = [key & word, key >> 64]
    x = [(counter >> 64 * i) & word for i in range(4)]
    for _ in range(10):
        a, b = 0xD2E7470EE14C6C93 * x[0], 0xCA5A826395121157 * x[2]
        x = [(b >> 64) ^ x[1] ^ k[0], b & word, (a >> 64) ^ x[3] ^ k[1], a & word]
        k = [(k[0] + 0x9E3779B97F4A7C15) & word, (k[1] + 0xBB67AE8584CAA73B) & word]
    return x[0]


def test_draws_are_those_of_the_generator_as_it_was_published():
    found = context("vary: {world.table.friction: 0..1}\n")
    stream = hashlib.sha256(b"7 world.table.friction").digest()
    key = int.from_bytes(stream[:16], "little")
    for number in (0, 1, 2, 1_000_000):
        value = random_world(found, 7, number).values["world.table.friction", None]
        # The generator counts before it draws.
        assert value == ((philox(key, (number << 64) + 1) >> 11) + 0.5) / 2**53


def test_uniform_and_normal_draws_have_their_distributions():
    """Kolmogorov's distance of n draws: below 1.95 / sqrt(n) but once in a thousand times."""
    found = context(
        "vary: {world.table.stiffness: 5..80 kN/m, world.table.xyz: [normal(2 mm), 0, 0]}\n"
    )
    n = 4000
    worlds = [random_world(found, 1, number).values for number in range(n)]
    stiffness = np.sort([each["world.table.stiffness", None] for each in worlds])
    steps = (np.arange(n) + 0.5) / n
    assert np.abs((stiffness - 5e3) / 75e3 - steps).max() < 1.95 / math.sqrt(n)
    place = np.sort([each["world.table.xyz", 0] for each in worlds])
    assert np.abs(place).max() <= 6e-3
    normal = NormalDist(0, 2e-3)
    inside = normal.cdf(6e-3) - normal.cdf(-6e-3)
    shares = np.array([(normal.cdf(x) - normal.cdf(-6e-3)) / inside for x in place])
    assert np.abs(shares - steps).max() < 1.95 / math.sqrt(n)
    # The two have nothing to do with each other: 4 standard deviations of no correlation.
    both = np.corrcoef(
        [each["world.table.stiffness", None] for each in worlds],
        [each["world.table.xyz", 0] for each in worlds],
    )
    assert abs(both[0, 1]) < 4 / math.sqrt(n)


def test_a_normal_value_stays_where_it_can_be():
    found = context("vary: {world.table.friction: normal(0.1)}\n")
    values = [random_world(found, 0, n).values["world.table.friction", None] for n in range(500)]
    assert min(values) >= 0
    # It is cut, not moved to the bound: nothing piles up there.
    assert sum(value < 1e-9 for value in values) == 0
    assert max(values) > 0.3


def test_values_with_a_common_name_vary_together():
    found = context(
        "vary: {dz: normal(2 mm), k: 10..20 kN/m, world.table.xyz: [0, 0, dz],"
        " world.wall.xyz: [0, 0, -2*dz], world.table.stiffness: k, world.wall.stiffness: 2*k}\n"
    )
    assert [draw.name for draw in draws_of(found)] == ["dz", "k"]
    for number in range(5):
        values = random_world(found, 0, number).values
        dz = values["world.table.xyz", 2] - 0.3
        assert values["world.wall.xyz", 2] == pytest.approx(-2 * dz, abs=1e-15)
        k = values["world.table.stiffness", None]
        assert 10e3 <= k <= 20e3
        assert values["world.wall.stiffness", None] == 2 * k
    assert corner_count(found) == 4
    corners = [corner_world(found, index).draws for index in range(4)]
    assert corners == [{"dz": z, "k": k} for z in (-6e-3, 6e-3) for k in (10e3, 20e3)]
    assert grid_count(found, 3) == 9
    points = [grid_world(found, 3, index).draws for index in range(9)]
    values = (-6e-3, 0.0, 6e-3), (10e3, 15e3, 20e3)
    assert points == [{"dz": z, "k": k} for z in values[0] for k in values[1]]
    # The last of a million costs what the first one does.
    assert grid_world(found, 1000, 999_999).draws == {"dz": 6e-3, "k": 20e3}


def test_of_many_numbers_one_at_a_time_is_at_an_end():
    six = "xyz: [+- 1 mm, +- 1 mm, +- 1 mm]", "rpy: [+- 1 deg, +- 1 deg, +- 1 deg]"
    each = [f"world.{name}.{entry}" for name in ("table", "wall") for entry in six]
    found = context(f"vary: {{{', '.join(each)}, world.table.friction: 0..1}}\n")
    assert corner_count(found) == 26
    ends = [corner_world(found, index).draws for index in range(26)]
    assert ends[0] == {"world.table.xyz.0": -1e-3}
    assert ends[1] == {"world.table.xyz.0": 1e-3}
    assert ends[24:] == [{"world.table.friction": 0}, {"world.table.friction": 1}]


def test_vary_is_about_the_truth():
    found = context(
        "truth: {world.table.xyz: [0, 0, 302 mm], world.table.stiffness: 10 kN/m}\n"
        "vary: {world.table.xyz: [0, 0, +- 1 mm], world.table.stiffness: +- 10 %}\n"
    )
    corners = [corner_world(found, i) for i in range(corner_count(found))]
    places = {each.values["world.table.xyz", 2] for each in corners}
    assert sorted(places) == pytest.approx([0.301, 0.303])
    stiffness = {each.values["world.table.stiffness", None] for each in corners}
    assert sorted(stiffness) == pytest.approx([9e3, 11e3])
    told = {d.name: d.written for d in deviations(found, true_world(found))}
    assert told == {
        "world.table.xyz.z": ("300 mm", "302 mm"),
        "world.table.stiffness": ("20 kN/m", "10 kN/m"),
    }


def test_the_plant_is_true_and_the_controller_is_told():
    """A payload, a tool that is heavier, and friction: in the plant's equations and nowhere else.

    With the arm at rest its generalised gravity differs by J^T m g of what is carried.
    """
    rest = (
        "truth: {robot.payload: {mass: 300 g, xyz: [0, 0, 20 mm]}, robot.tool.mass: 200 g,"
        " robot.joint_friction: 0.5 N*m}\n"
    )
    told, true = (compile_task(load_text(HEAD + text, "task.yaml")) for text in ("", rest))
    assert np.array_equal(told.context.start_gravity, true.context.start_gravity)
    plants = [assemble(each).plant for each in (told, true)]
    bias = [plant.data.qfrc_bias[plant.arm.velocities] for plant in plants]
    model, arm = plants[1].model, plants[1].arm
    assert model.body("tool").mass[0] == pytest.approx(0.5)
    lever = model.body("tool").ipos
    J = true.context.start_jacobian
    R, g = true.context.start_R, np.array([0.0, 0.0, -9.81])
    moment = np.cross(R @ lever, 0.5 * g)
    # What hangs on the tip exerts a wrench: gravity as a generalised force is J^T of it.
    expected = -J.T @ np.concatenate([0.5 * g, moment])
    assert bias[1] - bias[0] == pytest.approx(expected, abs=1e-9)
    assert model.dof_frictionloss[arm.velocities] == pytest.approx(0.5)
    assert not plants[0].model.dof_frictionloss.any()


def test_what_is_held_is_held_where_it_is():
    text = """taskspec: 1
robot: {model: panda, grasp: door.handle}
world: {door: {mechanism: hinge, xyz: [500 mm, -300 mm, 400 mm], handle: [0, 300 mm, 0]}}
frame: door
stages: {wait: {axes: {z: {velocity: 0}}, time: 10 ms}}
truth: {world.door.handle: [0, 310 mm, 0]}
"""
    program = compile_task(load_text(text, "task.yaml"), force=True)
    parts = assemble(program)
    # Relaxed: the coupling exerts nothing, though the handle is 10 mm from where it is told.
    assert np.linalg.norm(parts.plant.arm.wrench[:3]) < 1e-3
    moved = parts.plant.data.body("tool").xpos - program.context.start_p
    assert moved == pytest.approx([0, 0.01, 0], abs=1e-8)
