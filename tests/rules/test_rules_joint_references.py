"""Joint references and torques against the constraints that they are to fit, (4.101)-(4.103)."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text
from taskspec_runner import run

TASK = """
taskspec: 1
name: swings
robot: {model: planar3, start: {joints: [60 deg, -90 deg, 30 deg]}}
world: {bars: {equation: "EQUATION"}}
law: LAW
stages: {swing: {STAGE}}
"""
GOOD = {"EQUATION": "q1 + q2 + q3 = 0", "LAW": "hybrid-multipliers"}
KEEPS = 'joints: ["60 deg + 9 deg*sin(t/(1 s))", "-90 deg - 9 deg*sin(t/(1 s))", 30 deg], time: 2 s'
LEAVES = 'joints: ["60 deg + 9 deg*sin(t/(1 s))", -90 deg, 30 deg], time: 2 s'


def findings(**changes):
    filled = TASK
    for key, value in (GOOD | changes).items():
        filled = filled.replace(key, value)
    return check_task(load_text(filled, "t"))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"STAGE": f"path: {{{KEEPS}}}"}, []),
        ({"STAGE": f"path: {{{LEAVES}}}"}, ["TS252"]),
        ({"STAGE": f"path: {{{LEAVES}}}", "LAW": "hybrid"}, ["TS252"]),
        # Straight lines keep a flat constraint, and leave a curved one.
        ({"STAGE": "path: {joints: [40 deg, -60 deg, 20 deg], speed: 30 deg/s}"}, []),
        ({"STAGE": "path: {joints: [40 deg, -50 deg, 20 deg], speed: 30 deg/s}"}, ["TS252"]),
        # By the run's clock nothing is known before it.
        ({"STAGE": f"path: {{{LEAVES}}}".replace("t/(1 s)", "clock/(1 s)")}, []),
        # One side: beyond it counts where the stage has no set point there.
        ({"STAGE": f"path: {{{LEAVES}}}", "EQUATION": "q1 + q2 + q3 >= 0"}, []),
        ({"STAGE": f"path: {{{LEAVES}}}", "EQUATION": "q1 + q2 + q3 <= 0"}, ["TS252"]),
        # An equation that moves is somewhere else at every time.
        (
            {"STAGE": f"path: {{{KEEPS}}}", "EQUATION": "q1 + q2 + q3 = 0.1 rad*sin(clock/(1 s))"},
            [],
        ),
    ],
)
def test_motions_of_joints(changes, expected):
    assert [d.code for d in findings(**changes) if d.code != "TS130"] == expected


def test_the_message_has_distance_and_time():
    """The sum of the joints is off by 9 deg sin 1 at most, along a gradient of length sqrt(3)."""
    (found,) = findings(STAGE=f"path: {{{LEAVES}}}".replace("time: 2 s", "time: 1.5 s"))
    numbers = re.search(r"up to ([\d.]+) deg, at t = ([\d.]+) s", found.message)
    assert numbers is not None, found.message
    assert float(numbers[1]) == pytest.approx(9 * math.sin(1.5) / math.sqrt(3), rel=0.01)
    # It starts from rest, so that its own time is 0.1 s behind.
    assert float(numbers[2]) == pytest.approx(1.6, abs=0.01)


@pytest.mark.parametrize(
    ("torques", "expected"),
    [
        ("[1 N*m, 1 N*m, 1 N*m]", []),
        ("[0, 0, 0]", []),
        ("[1 N*m, 1 N*m, 0]", ["TS253"]),
        ("[t*1 N*m/(1 s), 1 N*m, 1 N*m]", ["TS253"]),
        ("[force.x*1 m, 1 N*m, 0]", []),  # What is measured is not known.
        ("[1 N*m, 1 N*m]", ["TS254"]),
        ("[1 N*m, 1 N, 0]", ["TS254"]),
    ],
)
def test_joint_torques(torques, expected):
    stage = f"constraints: {{bars: {{generalised: {torques}}}}}, path: {{{KEEPS}}}"
    assert [d.code for d in findings(STAGE=stage)] == expected
    alone = f"constraints: {{bars: {{generalised: {torques}}}}}, time: 1 s"
    at_start = [] if "t*" in torques and not expected else expected
    assert [d.code for d in findings(STAGE=alone)] == at_start


def test_what_is_left_is_that_of_the_projection():
    u = np.array([2.0, 1.0, -1.0])
    stage = "constraints: {bars: {generalised: [2 N*m, 1 N*m, -1 N*m]}}, time: 1 s"
    (found,) = findings(STAGE=stage)
    left = np.linalg.norm(u - u.mean())
    assert f"of {np.linalg.norm(u):.3g} N*m, {left:.3g} N*m are left" in found.message
    assert "[0.667 N*m, 0.667 N*m, 0.667 N*m]" in found.hint
    loaded = load_text(
        TASK.replace("STAGE", stage).replace("EQUATION", GOOD["EQUATION"])
        .replace("LAW", GOOD["LAW"]), "t",
    )  # fmt: skip
    result = run(loaded)
    residual = result.column("bars.residual")
    assert len(residual)
    assert np.abs(residual - left).max() < 1e-10
    # lambda_d along (1, 1, 1)/sqrt(3).
    assert result.column("bars.torque.ref")[-1] == pytest.approx(u.sum() / math.sqrt(3), abs=1e-10)
