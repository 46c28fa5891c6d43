"""What laws promise of signals stands in the summary, and in the charts as levels."""

from __future__ import annotations

import pytest

from taskspec.compiler import compile_unchecked
from taskspec.spec import load_text
from taskspec_runner.report.figures import sections
from taskspec_runner.session import execute_program

TASK = """\
taskspec: 1
name: bounds
robot:
  model: planar2
  start: {xyz: [400 mm, 100 mm, 0]}
law: LAW
stages:
  go: {axes: {y: {move: 20 mm}}, time: 0.3 s}
  wait: {law: pd, time: 0.1 s}
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """A run of the task under a law, and its charts by key."""

    def run(law):
        program = compile_unchecked(load_text(TASK.replace("LAW", law), "bounds.yaml"))
        made = execute_program(program, tmp_path_factory.mktemp("run"), report=False)
        assert made.summary["status"] == "done"
        return made, {chart.key: chart for part in sections(made) for chart in part.charts}

    return run


def test_layers_bound_the_errors_of_their_stage(ran):
    made, charts = ran("{kind: hybrid, sliding: {layer: 0.3 m/s, gain: 2 m/s^2}}")
    gains = made.program.stages[0].plan.gains
    # phi / Lambda, where damping ratio 1 has K_D = 2 Lambda.
    bound = 0.3 / (gains["K_D"]["y"].value / 2)
    found = made.summary["law_bounds"]
    assert found == {"go": {axis: pytest.approx(bound) for axis in ("error.x", "error.y")}}
    chart = charts["position error"]
    values = [level.value for level in chart.levels]
    assert values == pytest.approx([bound * chart.factor, -bound * chart.factor])
    assert {level.text for level in chart.levels} == {"bound of the layer"}
    assert {level.end for level in chart.levels} == {made.visits[0].end}


def test_a_tank_has_its_capacity_and_the_most_that_leaves_it(ran):
    made, charts = ran("{kind: pd, tank: {energy: 1 J, power: 5 W}}")
    assert made.summary["law_bounds"] == {"go": {"tank.energy": 1.0, "tank.power": 5.0}}
    for key, value, text in (
        ("tank", 1.0, "capacity"),
        ("tank power", 5.0, "most that leaves it"),
    ):
        (level,) = charts[key].levels
        assert (level.value, level.text) == (pytest.approx(value * charts[key].factor), text)
    shares = charts["tank shares"]
    assert (shares.unit, shares.always) == ("%", (0.0, 100.0))
    assert [trace.signal for trace in shares.traces] == ["tank.spring", "tank.share"]


def test_a_task_without_either_has_no_such_entry(ran):
    made, charts = ran("{kind: hybrid, disturbance_observer: 20 Hz}")
    assert "law_bounds" not in made.summary
    assert charts["position error"].levels == ()
    disturbances = charts["joint disturbances"]
    assert disturbances.title == "Disturbances of the joints"
    assert disturbances.note == "as the observer estimates them, and takes them off"
