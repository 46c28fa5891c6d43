"""A law that is defined here and nowhere else: hybrid control without an integral of the force."""

from __future__ import annotations

import pytest
from extension import column

from taskspec.control.command import Command
from taskspec.laws import ControlLaw, register
from taskspec.laws.case import Case
from taskspec.laws.gains import (
    BANDWIDTH,
    DAMPING_RATIO,
    FORCE_DAMPING,
    FORCE_PROPORTIONAL,
    K_D,
    K_P,
)

LAWS = ("proportional", "hybrid")
TASK = """\
taskspec: 1
name: press
robot: {model: planar2, tool: {radius: 100 um}, start: {xyz: [400 mm, 100 mm, 0]}}
world: {wall: {shape: plane, xyz: [408 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 10 kN/m}}
law: {kind: proportional, force: {proportional: 0.5, damping: 60 N*s/m}}
stages:
  approach: {axes: {x: {force: 2 N, ramp: 10 ms}}, until: force.x > 0.5 N, within: {time: 3 s}}
  press: {axes: {x: {force: 5 N, ramp: 50 ms}}, time: 1 s}
expect: [last(press.force.x) within 5 N +- 50 mN]
"""
WRONG = TASK.replace("proportional: 0.5,", "integral: 3 /s,")


class Proportional(ControlLaw):
    """Motion axes by acceleration; on force axes u = f_d + p (f_d - f) - d v."""

    kind = "proportional"
    title = "proportional control of the force"
    equations = "(9.1), (9.2)"
    gains = (BANDWIDTH, DAMPING_RATIO, FORCE_PROPORTIONAL, FORCE_DAMPING)
    derived = (K_P, K_D)
    force_loop = True
    selects = True
    axis_springs = False

    def command(self, case: Case) -> Command:
        state, reference = case.state, case.reference
        acceleration = (
            reference.acceleration
            + case.diagonal("K_D") * (reference.velocity - state.velocity)
            + case.diagonal("K_P") * reference.error
        )
        acceleration[state.rows(case.force)] = 0.0
        desired, measured = case.applied(reference.force), case.applied(state.f)
        p, d = case.diagonals("force.proportional", "force.damping")
        error = desired - measured
        wrench = desired + p * error - d * state.velocity
        return Command(acceleration=acceleration, wrench=wrench)


def define() -> None:
    register(Proportional)


def test_it_is_validated(said):
    assert said["validate"].exit_code == 0, said["validate"].text
    assert said["mistake"].exit_code == 2
    refused = "wrong.yaml:5:35: error[TS207]: the law 'proportional' has no gain 'force.integral'"
    assert refused in said["mistake"].text
    assert (said["refused"].exit_code, refused in said["refused"].text) == (2, True)


def test_it_is_explained(said):
    assert said["explain"].exit_code == 0, said["explain"].text
    for word in ("proportional", "(9.2)", "force.damping", "60 N*s/m"):
        assert word in said["explain"].text


def test_it_runs_as_its_equation_says(said):
    """In free space the force axis moves at (1 + p) f_d / d; in contact it has f_d."""
    assert said["run"].exit_code == 0, said["run"].text
    approach = column(said["run"], "stage") == "approach"
    speed = column(said["run"], "velocity.x")[approach]
    # The lag of h / d is 37 ms, of which the approach lasts five.
    assert speed.max() == pytest.approx(1.5 * 2.0 / 60.0, rel=1e-2)
    assert column(said["run"], "force.x")[-1] == pytest.approx(5.0, rel=1e-3)


def test_it_is_compared(said):
    assert said["compare"].exit_code == 0, said["compare"].text
    passed = [line for line in said["compare"].text.splitlines() if " passed " in line]
    assert {line.split()[0] for line in passed} == {"as", *LAWS}  # the file as written too
    assert "proportional" in said["compare"].file("compare/compare.html")


def test_it_is_in_the_report(said):
    assert said["report"].exit_code == 0
    assert "proportional" in said["report"].file("run/report.html")


def test_it_is_in_the_schema(said):
    assert said["schema"].exit_code == 0
    names, law = said["schema"].json["$defs"]["Law"]["anyOf"]
    assert "proportional" in names["enum"]
    assert "proportional" in law["properties"]["kind"]["enum"]
