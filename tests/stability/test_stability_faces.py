"""Gains that are designed for a flat tool whose force changes."""

from __future__ import annotations

import pytest

from taskspec.examination import check_task
from taskspec.planning import plan_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
robot:
  {{model: panda, tool: {{shape: cylinder, radius: 12 mm}}, start: {{xyz: [450 mm, 0, 312 mm]}}}}
world: {{table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: 81 kN/m, damping: 120 N*s/m}}}}
frame: table
law: LAW
stages:
  go: {{axes: {{z: {{velocity: -20 mm/s}}}}, until: force.z < -2 N, within: 3 s}}
  press:
    axes: {{z: {{force: {force}}}, rx: {{torque: 0}}, ry: {{torque: 0}}}}
    time: 1 s
"""
VARYING = "-(26 N + 8 N * sin(2*pi*t/(1.3 s)))"


@pytest.mark.parametrize("law", ["hybrid", "hybrid-reaction", "parallel"])
def test_a_face_is_steadied_for_the_most_that_its_force_comes_to(law: str) -> None:
    """The face resists being tilted by f r^2 / rounding: what is designed for f = 0 swings."""

    def damping(force: str) -> float:
        task = load_text(TASK.replace("LAW", law).format(force=force), "t.yaml")
        gains = plan_task(task).stages["press"].gains
        name = "force.damping" if law.startswith("hybrid") else "damping"
        return float(next(g.value for axis, g in gains[name].items() if str(axis) == "rx"))

    text = TASK.replace("LAW", law).format(force=VARYING)
    codes = {d.code for d in check_task(load_text(text, "t.yaml"))}
    assert not codes & {"TS501", "TS502"}
    # The swell comes to 34 N within the stage, a quarter of its period after it begins.
    assert damping(VARYING) == pytest.approx(damping("-34 N"), rel=1e-3)
