"""Boundaries of force loops over servos: the fixed parts of `make boundaries` and its designs."""

from __future__ import annotations

import pytest
from boundaries import COMMANDS, DAMPING, PROMISED, Case, Row, cases
from servo_tasks import ARMS, JUDGING, LAWS, Press, looked


def test_the_campaign_has_six_servos_three_delays_and_three_stiffnesses():
    every = list(cases(range(6)))
    assert len(every) == len(set(every)) == 6 * 3 * 3 * len(DAMPING) * len(COMMANDS)


@pytest.mark.parametrize(
    "case",
    [
        Case(20, 0.7, 2, 20, "velocity", "force-velocity"),
        Case(10, 1.0, 4, 80, "position", "admittance"),
    ],
    ids=str,
)
def test_runs_have_the_boundary_of_the_sampled_loop_and_of_the_closed_form(case):
    row = Row.of(case)
    assert abs(row.off) < PROMISED / 2
    assert row.formed == pytest.approx(row.predicted, rel=2e-3)


def test_presses_have_every_arm_law_command_and_servo():
    texts = "\n".join(Press.of(number).text() for number in range(JUDGING, JUDGING + 60))
    words = [f"model: {arm}" for arm in ARMS] + [f"command: {each}" for each in COMMANDS]
    words += [f"law: {law}\n" for law in LAWS] + ["mass: ", "filter: ", "delay: ", "stiffness: ["]
    words += ["at: wrist", "x: {velocity", "rate: 125 Hz", "plant_rate: 4 kHz", "N*s/m"]
    assert [word for word in words if word not in texts] == []


@pytest.mark.parametrize("number", range(JUDGING, JUDGING + 6))
def test_designed_gains_are_stable_and_far_from_their_boundary(number):
    press = Press.of(number)
    program = press.program()
    if program is None:
        pytest.skip("the arm cannot be there, or its servo is not stable")
    found = looked(press, program, run=number % 3 == 0)
    assert found.holds, found
