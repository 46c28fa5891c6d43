"""Shapes on mechanisms: pushed by the tool, and moved with what carries them."""

from __future__ import annotations

import numpy as np
import pytest

from plants import Pushed
from taskspec.geometry.rotation import from_rpy, to_rpy
from taskspec.program.world.stiffness import mobility_of

#: Something to push along the world's -z, under a tip at rest: each kind by its own ways.
SLIDE = "mechanism: slide, xyz: [500 mm, 0, 300 mm], rpy: [180 deg, 0, 0], mass: 200 g"
HINGE = "mechanism: hinge, xyz: [400 mm, 0, 300 mm], rpy: [-90 deg, 0, 0], inertia: 0.02 kg*m^2"
SCREW = (
    "mechanism: screw, xyz: [400 mm, 0, 300 mm], rpy: [-90 deg, 0, 0], inertia: 0.02 kg*m^2, "
    "mass: 100 g, pitch: 3 mm/turn"
)


@pytest.mark.parametrize("seed", range(20))
def test_roll_pitch_yaw_of_a_rotation(seed):
    rpy = np.random.default_rng(seed).uniform(-np.pi, np.pi, 3)
    rpy[1] = np.pi / 2 if seed == 0 else rpy[1]
    R = from_rpy(rpy)
    np.testing.assert_allclose(from_rpy(to_rpy(R)), R, atol=1e-14)


@pytest.mark.parametrize("knob", ["fixed", "free"])
@pytest.mark.parametrize("declared", [SLIDE, HINGE, SCREW])
def test_mobility_is_what_mujoco_counts(declared, knob):
    cap = "shape: box, on: mech, xyz: [100 mm, 0, 20 mm], size: [40 mm, 40 mm, 40 mm]"
    pushed = Pushed(f"mech: {{{declared}, knob: {knob}}}, cap: {{{cap}}}")
    counted = pushed.model.body("world/mech").invweight0[0]
    # The weight of a free knob is 1e-5 of it.
    assert mobility_of(pushed.task.shapes["cap"]) == pytest.approx(counted, rel=2e-5, abs=1e-9)


CAP = (
    "shape: box, on: mech, size: [40 mm, 40 mm, 40 mm], stiffness: 5 kN/m, damping: 50 N*s/m, "
    "friction: 0.5"
)
#: Where the cap's face is 5 mm below the tip, in the axes of each.
BELOW = {"slide": "xyz: [0, 0, -20 mm]", "hinge": "xyz: [100 mm, -20 mm, 0]"}
BELOW["screw"] = BELOW["hinge"]


def on_cap(declared: str) -> Pushed:
    """A tool with a ball at its tip, above a cap on a mechanism."""
    kind = declared.split()[1].rstrip(",")
    return Pushed(
        f"mech: {{{declared}}}, cap: {{{CAP}, {BELOW[kind]}}}",
        "tool: {shape: sphere, radius: 5 mm, length: 100 mm}",
        start="[500 mm, 0, 345 mm]",
        damping=20.0,
    )


@pytest.mark.parametrize(
    "declared",
    [SLIDE + ", stop: [0, 2 mm]", HINGE + ", stop: [0, 1 deg]", SCREW + ", stop: [0, 1 deg]"],
)
def test_a_press_against_the_stop_has_the_declared_stiffness(declared):
    """What the contact gives way is f/k, to 0.1 %, wherever the stop has let the shape go."""
    pushed = on_cap(declared)
    pushed.push([0.0, 0.0, -8.0], 4.0)
    cap = pushed.data.geom("world/cap")
    # The tip is the ball's end; its middle is a radius behind.
    middle = pushed.tip - 0.005 * pushed.data.xmat[pushed.body].reshape(3, 3)[:, 2]
    place = cap.xmat.reshape(3, 3).T @ (middle - cap.xpos)
    gap = np.max(np.abs(place)) - 0.020 - 0.005
    force = pushed.plant.views.objects[0]
    assert abs(pushed.plant.views.mechanism_positions[0]) > 1e-3
    assert force > 7.5
    assert -gap == pytest.approx(force / 5e3, rel=1e-3)


@pytest.mark.parametrize(
    ("declared", "inertia"),
    [
        (SLIDE + ", damping: 8 N*s/m", 0.2),
        (HINGE + ", damping: 0.2 N*m*s/rad", 0.02),
        (SCREW + ", damping: 0.2 N*m*s/rad", 0.02 + 0.1 * (0.003 / (2 * np.pi)) ** 2),
    ],
)
def test_what_is_pushed_moves_as_its_effort_says(declared, inertia):
    """I s'' + b s' is the generalised force that the contact is said to apply."""
    pushed = on_cap(declared)
    damping = pushed.task.mechanisms["mech"].damping
    rates, efforts = [], []
    for _ in range(400):
        pushed.push([0.0, 0.0, -6.0], 1e-3)
        rates.append(pushed.plant.views.mechanism_rates[0])
        efforts.append(pushed.plant.views.mechanism_efforts[0])
    rate, effort = np.array(rates), np.array(efforts)
    # A rate is that at a step's beginning, an effort that of the step; damping is implicit.
    told = inertia * np.diff(rate) / 1e-3 + damping * rate[1:]
    assert np.max(effort) > 0.3
    np.testing.assert_allclose(told, effort[:-1], atol=2e-3 * np.max(effort))


LEAF = """
taskspec: 1
name: leaf
robot:
  model: panda
  tool: {shape: sphere, radius: 10 mm, length: 100 mm, mass: 200 g}
  start: {xyz: [450 mm, 0, 350 mm]}
world:
  door: {mechanism: hinge, xyz: [480 mm, 250 mm, 350 mm], handle: [0, -250 mm, 0],
         inertia: 0.1 kg*m^2, damping: 0.5 N*m*s/rad, friction: 0.2 N*m, stop: [-1 deg, 80 deg]}
  leaf: {shape: box, on: door, xyz: [10 mm, -150 mm, 0], size: [20 mm, 300 mm, 200 mm],
         friction: 0.2}
law: parallel
frame: door.handle
stages:
  reach: {axes: {y: {velocity: 40 mm/s}}, until: force.y > 1 N, within: {time: 2 s}}
  push: {axes: {y: {velocity: 80 mm/s}}, time: 1.5 s}
"""


def test_a_leaf_is_pushed_open_and_its_gap_goes_with_it(simulate):
    run = simulate(LEAF)
    # From 0.9 s into the push on the door goes at an even rate, 80 mm/s at 250 mm.
    late = slice(len(run["clock"]) - 400, -1)
    rate = np.gradient(run["door.angle"], 1e-3)[late]
    assert run["door.angle"][-1] > 0.3
    np.testing.assert_allclose(rate, 0.32, rtol=0.02)
    # Friction and damping are all that it takes.
    np.testing.assert_allclose(run["door.torque"][late], 0.2 + 0.5 * rate, rtol=0.02)
    # The gap is that to the leaf where it is, a tick before the force.
    np.testing.assert_allclose(run["leaf.gap"][late], -run["leaf.force"][late] / 20e3, rtol=0.02)
