"""What the rows of a sweep say together, against closed forms."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
import pytest

from taskspec.compiler import compile_task
from taskspec.program.worlds import random_world
from taskspec.spec import load_text
from taskspec.spec.sweep import RateExpectation
from taskspec_runner.sweep.kept import WORST, chosen
from taskspec_runner.sweep.statistics import Rate, influences, ranks, regions
from taskspec_runner.sweep.summary import (
    MET,
    MISSED,
    UNDECIDED,
    JudgedRate,
    rate_text,
    summarise,
)
from taskspec_runner.sweep.worlds import CORNERS, GRID

TASK = """taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 310 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm]}}
frame: table
stages: {wait: {axes: {z: {velocity: 0}}, time: 10 ms}}
vary: {world.table.stiffness: 0.5..100.5 kN/m}
"""


def coverage(p: float, n: int) -> float:
    """Of the interval of n tries with probability p: the binomial sum over what contains p."""
    total = 0.0
    for good in range(n + 1):
        low, high = Rate(good, n).interval()
        if low <= p <= high:
            total += math.comb(n, good) * p**good * (1 - p) ** (n - good)
    return total


def test_intervals_against_their_equation():
    """Its ends solve |s - p| = z sqrt(p (1 - p) / n)."""
    z = NormalDist().inv_cdf(0.975)
    for good, n in ((1, 10), (50, 100), (990, 1000), (3, 7)):
        for p in Rate(good, n).interval():
            assert abs(good / n - p) == pytest.approx(z * math.sqrt(p * (1 - p) / n), rel=1e-9)
    assert Rate(0, 5).interval()[0] == 0
    assert Rate(5, 5).interval()[1] == 1
    assert Rate(0, 0).interval() == (0.0, 1.0)


def test_four_hundred_sweeps_are_covered_as_often_as_the_binomial_sum_says():
    """A press that succeeds below 90.5 kN/m succeeds with p = 0.9 in worlds of 0.5..100.5 kN/m."""
    context = compile_task(load_text(TASK, "task.yaml")).context
    n, sweeps, p = 40, 400, 0.9
    exact = coverage(p, n)
    assert 0.9 < exact < 1
    covered = 0
    for seed in range(sweeps):
        good = sum(
            random_world(context, seed, number).values["world.table.stiffness", None] < 90.5e3
            for number in range(n)
        )
        low, high = Rate(good, n).interval()
        covered += low <= p <= high
    assert abs(covered - sweeps * exact) < 3 * math.sqrt(sweeps * exact * (1 - exact))


@pytest.mark.parametrize(
    ("good", "n", "verdict"),
    [(1000, 1000, MET), (995, 1000, UNDECIDED), (980, 1000, MISSED), (20, 20, UNDECIDED)],
)
def test_a_rate_is_met_missed_or_undecided(good, n, verdict):
    judged = JudgedRate.of(RateExpectation("success", 0.99, "success >= 99 %"), Rate(good, n))
    assert judged.verdict == verdict
    if verdict == UNDECIDED:
        # So many more at the same share decide it, and not one less.
        total = n + judged.needed
        low, high = Rate(round(good / n * total), total).interval()
        assert low > 0.99 or high < 0.99


def rows(failing) -> list[dict[str, object]]:
    rng = np.random.default_rng(4)
    made = []
    for number in range(400):
        friction, stiffness, other = rng.uniform(size=3)
        bad = failing(friction, stiffness)
        made.append(
            {
                "world": number,
                "status": "done",
                "success": not bad,
                "margin": 0.5 - friction + 0.05 * other,
                "world.a.friction": friction,
                "world.a.stiffness": stiffness,
                "world.a.damping": other,
                "world.a.radius": 1.0,
            }
        )
    return made


def test_a_tree_finds_where_worlds_fail():
    (found,) = regions(rows(lambda friction, stiffness: friction > 0.7 and stiffness < 0.4))
    splits = {(s.parameter, s.above): s.value for s in found.splits}
    # The edge lies between two of 400 values, some 2.5 thousandths apart.
    assert splits["world.a.friction", True] == pytest.approx(0.7, abs=0.02)
    assert splits["world.a.stiffness", False] == pytest.approx(0.4, abs=0.02)
    assert found.failed / found.of > 0.9


def test_no_tree_grows_where_chance_decides():
    rng = np.random.default_rng(7)
    assert regions(rows(lambda *_: rng.uniform() < 0.1)) == []
    assert regions(rows(lambda *_: False)) == []
    assert regions(rows(lambda *_: True)) == []


def test_what_matters_is_found_by_ranks():
    first, *others = influences(rows(lambda *_: False))
    assert first.parameter == "world.a.friction"
    assert first.correlation < -0.95
    assert first.chance < 1e-9
    # What is the same in all worlds is no parameter; of what does not matter chance is likely.
    assert {each.parameter for each in others} == {"world.a.stiffness", "world.a.damping"}
    assert next(e.chance for e in others if e.parameter == "world.a.stiffness") > 0.001


def test_ranks_of_ties_are_shared():
    assert ranks(np.array([3.0, 1.0, 3.0, 2.0])).tolist() == [3.5, 1, 3.5, 2]


def test_an_expectation_with_a_name_has_a_rate():
    text = TASK + (
        "expect: {soft: max(norm(force)) < 15 N, there: last(wait.gap) < 20 mm}\n"
        "sweep: {expect: [soft >= 50 %, success >= 50 %]}\n"
    )
    task = load_text(text, "task.yaml").task
    made = [
        {"world": n, "success": n < 10, "status": "done", "verdict": "passed", "margin": 0.1,
         "expect soft": True, "expect there": n < 10}
        for n in range(40)
    ]  # fmt: skip
    summary = summarise(task, made)
    assert [each["verdict"] for each in summary["judged"]] == [MET, MISSED]
    assert {each["name"]: each["good"] for each in summary["expectations"]} == {
        "soft": 40,
        "there": 10,
    }
    assert summary["exit_code"] == 1


@pytest.mark.parametrize("kind", [CORNERS, GRID])
def test_worlds_that_were_chosen_tell_of_no_probability(kind):
    """Their share itself is held against the bound: there are no more of them to ask."""
    task = load_text(TASK + "sweep: {expect: success >= 75 %}\n", "task.yaml").task
    for good, verdict in ((3, MET), (2, MISSED)):
        made = [
            {"world": n, "success": n < good, "status": "done", "verdict": "passed", "margin": 0.1}
            for n in range(4)
        ]
        summary = summarise(task, made, kind)
        (judged,) = summary["judged"]
        assert (judged["verdict"], judged["needed"], judged["interval"]) == (verdict, None, None)
        assert rate_text(judged) == f"{good} of 4 worlds, {25 * good} %"
        assert summarise(task, made)["judged"][0]["verdict"] == UNDECIDED


def test_a_run_that_broke_off_is_judged_as_far_as_it_got():
    """39 of 40 worlds touch nothing and end early; they stayed below 30 N as far as they got."""
    text = TASK + (
        "expect: {gentle: max(norm(force)) < 30 N, there: last(wait.gap) < 20 mm}\n"
        "sweep: {expect: [gentle >= 80 %, success >= 20 %]}\n"
    )
    task = load_text(text, "task.yaml").task
    early = {"success": False, "status": "failed", "verdict": "failed", "reason": "travel",
             "margin": None, "expect gentle": None, "expect there": False}  # fmt: skip
    made = [{**early, "world": n, "duration": 1.0 - 0.01 * n} for n in range(39)]
    last = {"success": False, "status": "done", "verdict": "missed", "duration": 4.0,
            "margin": -0.1, "expect gentle": True, "expect there": False}  # fmt: skip
    made.append({**last, "world": 39})
    summary = summarise(task, made)
    gentle, there = summary["expectations"]
    assert (gentle["good"], gentle["of"], gentle["so_far"]) == (40, 40, 39)
    assert (there["good"], there["so_far"]) == (0, 0)
    assert [each["verdict"] for each in summary["judged"]] == [MET, MISSED]
    assert rate_text(gentle).endswith("; 39 of them as far as they got")
    assert rate_text(there) == "0 of 40 worlds, 0 % (0 to 8.762 %)"
    # The first that ended early, as none of them has a margin; and the one that was run to its end.
    assert summary["worst"] == [
        {"end": "failed: travel", "world": 38, "margin": None},
        {"end": "missed", "world": 39, "margin": -0.1},
    ]
    assert chosen(WORST, made) == [38, 39]


def test_a_world_that_could_not_be_run_met_nothing():
    task = load_text(TASK + "expect: {gentle: max(norm(force)) < 30 N}\n", "task.yaml").task
    made = [
        {"world": 0, "success": True, "status": "done", "verdict": "passed", "margin": 0.2,
         "expect gentle": True},
        {"world": 1, "success": False, "status": "broken", "verdict": "broken", "text": "why",
         "expect gentle": None},
    ]  # fmt: skip
    summary = summarise(task, made)
    assert summary["expectations"][0]["good"] == 1
    assert [each["world"] for each in summary["worst"]] == [0]
