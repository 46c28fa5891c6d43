"""A counterweight carries the arm, and the joints' damping is the plant's alone."""

from __future__ import annotations

import numpy as np
import pytest

STILL = """
taskspec: 1
name: still
robot: {model: panda, start: {xyz: [500 mm, 0, 500 mm]}, ROBOT}
law: LAW
stages: {wait: {time: 0.5 s}}
"""


def test_a_balanced_arm_stays_without_any_torque(simulate):
    text = STILL.replace("LAW", "stiffness").replace("ROBOT", "balanced: true")
    run = simulate(text)
    for i in range(7):
        # Rounding alone moves it: gravity and its compensation agree to 1e-14.
        assert np.abs(run[f"joint.{i + 1}.torque"]).max() < 1e-6
        assert np.ptp(run[f"joint.{i + 1}.position"]) < 1e-8


def test_without_a_counterweight_stiffness_control_sags(simulate):
    run = simulate(STILL.replace("LAW", "stiffness").replace("ROBOT", "balanced: false"))
    assert run["error.z"][-1] > 0.01


@pytest.mark.parametrize("damping", ["3 N*m*s/rad", "[3 N*m*s/rad, 0, 0, 0, 0, 0, 0]"])
def test_joint_damping_brakes_a_joint(simulate, damping):
    """A joint pushed by a spring law loses the energy that the dampers take."""
    moving = STILL.replace("time: 0.5 s", "axes: {y: {move: 50 mm}}").replace("LAW", "pd")
    free = simulate(moving.replace("ROBOT", "joint_damping: 0"))
    braked = simulate(moving.replace("ROBOT", f"joint_damping: {damping}"))
    assert np.max(braked["joint.1.velocity"]) < np.max(free["joint.1.velocity"])
