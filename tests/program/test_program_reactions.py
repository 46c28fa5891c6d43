"""Limits that lead to a stage: when they are crossed, and when they count again."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from numpy.typing import NDArray

from taskspec.compiler import compile_task
from taskspec.program.execution.exits import RESTS
from taskspec.spec import load_text
from taskspec.spec.limits import Bound
from taskspec.text.diagnostic import SpecError
from taskspec_runner.trial.trial import Trial, trial

Vector = NDArray[np.float64]

HEAD = """taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 320 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
frame: table
"""
DOWN = "  down: {axes: {z: {velocity: -40 mm/s}}, until: force.z < -2 N, within: 5 s}\n"
RISES = "  press: {axes: {z: {force: -5 N - 10 N/s * t, ramp: 0}}, time: 3 s, next: end}\n"


def tried(text: str) -> Trial:
    return trial(compile_task(load_text(HEAD + text, "t"), force=True))


def ended(found: Trial) -> tuple[str, str, str]:
    return found.outcome.status, found.outcome.stage, found.outcome.reason


def times(found: Trial, stage: str) -> Vector:
    """(k,) stage time of a stage's ticks [s]."""
    return found.history.columns["t"][found.history.window(stage)]


def test_it_ends_the_stage_when_the_value_passes_it():
    found = tried(
        "limits: {force: {max: 15 N, then: lift}}\nstages:\n"
        + DOWN
        + RISES
        + "  lift: {axes: {z: {move: 20 mm}}}\n"
    )
    assert ended(found)[:2] == ("done", "lift")
    press = found.history.window("press")
    force = np.linalg.norm([found.history.columns[f"force.{axis}"] for axis in "xyz"], axis=0)
    # The set point passes 15 N after 1 s; a loop with an integral i follows a ramp 1/i late.
    assert times(found, "press")[-1] == pytest.approx(1.0, abs=0.15)
    assert force[press][:-1].max() <= 15
    assert force.max() < 15.3


def test_where_it_stays_crossed_it_counts_again_after_half_a_second():
    found = tried(
        "limits: {force: {max: 15 N, then: keep}}\nstages:\n"
        + DOWN
        + RISES
        + "  keep: {axes: {z: {force: -30 N}}, time: 3 s}\n"
    )
    # In its own stage it stops the run.
    assert ended(found) == ("stopped", "keep", "force")
    assert times(found, "keep")[-1] == pytest.approx(RESTS, abs=1.5e-3)


def test_what_rests_rests_over_several_stages():
    found = tried(
        "limits: {force: {max: 15 N, then: keep}}\nstages:\n"
        + DOWN
        + RISES
        + "  keep: {axes: {z: {force: -30 N}}, time: 0.2 s, attempts: 1}\n"
        + "  more: {axes: {z: {force: -30 N}}, time: 3 s}\n"
    )
    assert ended(found)[:2] == ("failed", "more")
    assert times(found, "more")[-1] == pytest.approx(RESTS - 0.2, abs=1.5e-3)


def test_once_kept_again_it_counts_at_once():
    found = tried(
        "limits: {force: {max: 15 N, then: ease}}\nstages:\n"
        + DOWN
        + RISES
        + "  ease: {axes: {z: {force: -5 N - 60 N/s * (t - 0.1 s), ramp: 0}}, time: 3 s}\n"
    )
    # Eased within the first tenth of a second; the set point is back at 15 N after 0.27 s.
    assert ended(found)[:2] == ("stopped", "ease")
    assert 0.2 < times(found, "ease")[-1] < RESTS


def test_a_stage_of_its_own_limit_goes_before_that_of_the_task():
    found = tried(
        "limits: {force: {max: 15 N, then: lift}}\nstages:\n"
        + DOWN
        + RISES.replace("next: end", "next: end, limits: {force: 12 N}")
        + "  lift: {axes: {z: {move: 20 mm}}}\n"
    )
    assert ended(found) == ("stopped", "press", "force")


@pytest.mark.parametrize(("attempts", "codes"), [("", {"TS604"}), (", attempts: 2", set())])
def test_a_circle_over_a_limit_needs_attempts(attempts, codes):
    text = (
        f"limits: {{speed: {{max: 1 m/s, then: b}}}}\nstages:\n  a: {{time: 1 s, next: end"
        f"{attempts}}}\n  b: {{time: 1 s, next: a}}\n"
    )
    try:
        load_text(HEAD + text, "t")
        found = set()
    except SpecError as error:
        found = {d.code for d in error.diagnostics}
    assert found == codes


def test_a_bound_is_its_number_and_copies_with_its_stage():
    bound = Bound(40.0, "lift")
    assert bound == 40
    assert copy.deepcopy(bound).then == "lift"
