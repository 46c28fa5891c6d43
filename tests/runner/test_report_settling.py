"""The chart of a press under the PID regulator, below the bound of Theorem 4.1."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.spec import load_text
from taskspec_runner import run
from taskspec_runner.pages.numbers import figure
from taskspec_runner.report.figures import sections
from taskspec_runner.report.settling import settlings

TASK = """
taskspec: 1
name: settle
robot: {model: panda, start: {xyz: [500 mm, 0, 300 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m, damping: 20 N*s/m}}
law: LAW
stages:
  press: {axes: {z: {force: -10 N}}, time: 1.2 s}
  slide: {axes: {z: {force: -10 N}, x: {velocity: 10 mm/s}}, time: 0.3 s}
expect: []
"""
PID = (
    "{kind: parallel-pid, stiffness: 500 N/m, damping: DAMPING N*s/m, "
    "force: {proportional: 0.3, integral: 3 /s}}"
)


def made(tmp_path, law):
    return run(load_text(TASK.replace("LAW", law), "task.yaml"), out=tmp_path / "run")


def settling_charts(result):
    return [c for part in sections(result) for c in part.charts if c.key == "settling"]


def test_a_press_is_drawn_below_its_bound(tmp_path):
    """From the end of the ramp, 0.2 s, to the end of the stage; a stage that slides has none."""
    result = made(tmp_path, PID.replace("DAMPING", "80"))
    (chart,) = settling_charts(result)
    assert chart.log
    error, bound = (trace.values for trace in chart.traces)
    rows = np.flatnonzero(np.isfinite(bound))
    assert rows[0] == pytest.approx(200, abs=3)
    assert rows[-1] == 1199
    drawn = np.isfinite(error)
    assert drawn.sum() > 500
    assert (error[drawn] < bound[drawn]).all()
    (each,) = settlings(result)
    above = each.bound.region / each.error[0]
    assert f"{figure(above, 2)} times ||e|| at its start" in chart.note
    assert "Theorem 4.1" in result.plot()._repr_svg_()


def test_gains_outside_the_theorem_are_said_to_have_no_bound(tmp_path):
    """rho > 3 / 1.3 and 14 N s/m is less than rho times the arm's mass of some 6 kg."""
    result = made(tmp_path, PID.replace("DAMPING", "14"))
    (chart,) = settling_charts(result)
    assert [trace.label for trace in chart.traces] == ["||e||"]
    assert "do not satisfy (4.70), (4.71)" in chart.note


def test_other_laws_have_no_such_chart(tmp_path):
    result = made(tmp_path, "parallel")
    assert result.summary["status"] == "done"
    assert settling_charts(result) == []
