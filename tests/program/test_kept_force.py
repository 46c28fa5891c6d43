"""`hold: force`: a stage that keeps the set point of the stage before it."""

from __future__ import annotations

import numpy as np
import pytest

TASK = """
taskspec: 1
name: kept
robot: {{model: panda, start: {{xyz: [500 mm, 0, 331 mm]}}}}
world: {{table: {{shape: plane, xyz: [0, 0, 330 mm], stiffness: 20 kN/m, friction: 0.1}}}}
law: {law}
stages:
  press:
    axes: {{x: {{velocity: 20 mm/s}}, z: {{force: {force}}}}}
    time: 1.5 s
  rest: {{axes: {{z: {{hold: force}}}}, time: 1 s}}
  still: {{axes: {{z: {{hold: force}}}}, time: 0.5 s}}
expect: []
"""


@pytest.mark.parametrize("law", ["hybrid", "parallel", "pd"])
@pytest.mark.parametrize(
    ("force", "last"),
    # smooth(3/4) = (3/4)^3 (10 - 3/4 (15 - 6 3/4)), at the tick that ends the stage.
    [("-12 N", -12.0), ("-10 N - 8 N*smooth(t/(2 s))", -10 - 8 * 0.896484375)],
)
def test_the_last_set_point_is_kept(simulate, law, force, last):
    run = simulate(TASK.format(law=law, force=force))
    for stage in ("rest", "still"):
        kept = run.during(stage, "force.z.ref")
        # It rises from the measured force, and is there after 0.2 s. The frame is the world's.
        np.testing.assert_allclose(kept[200:], last, atol=1e-9)
    # What is felt does not jump: over the change of stage it goes on as in the stages.
    change = int(np.flatnonzero(run.history.stages == "rest")[0])
    steps = np.abs(np.diff(run["force.z"]))
    assert steps[change - 3 : change + 50].max() < 0.1
    # Motion directions hold: the reference has come to rest.
    x = run.during("still", "position.x.ref")
    assert np.ptp(x) < 1e-9


def test_a_known_force_is_known_before_the_run(simulate):
    first = simulate(TASK.format(law="hybrid", force="-12 N")).program.stages
    assert [stage.plan.set_points.of("z") for stage in first] == [-12.0] * 3
    later = simulate(TASK.format(law="hybrid", force="-10 N - t*1 N/s")).program.stages
    assert [stage.plan.set_points.of("z") for stage in later] == [None] * 3
