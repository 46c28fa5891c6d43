"""Ways on by condition, and stages that are repeated, on the closed loop."""

from __future__ import annotations

import itertools

import pytest

from taskspec.compiler import compile_task
from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError
from taskspec_runner.trial.trial import trial

HEAD = "taskspec: 1\nrobot: {model: planar2}\nstages:\n"


def way(stages: str) -> tuple[list[str], str]:
    """The stages of a run, one after the other, and how it ended."""
    found = trial(compile_task(load_text(HEAD + stages, "t")))
    return [visit.stage for visit in found.history.visits()], found.outcome.status


@pytest.mark.parametrize(
    ("stages", "expected"),
    [
        ("  a: {time: 20 ms, repeat: 3}\n  b: {time: 10 ms}\n", "aaab"),
        (
            "  a: {time: 20 ms}\n  b: {time: 10 ms, next: [{when: b.visits < 3, to: a}, end]}\n",
            "ababab",
        ),
        (
            "  a: {time: 20 ms, next: [{when: a.visits >= 2, to: c}, {when: clock > 1 s, to: b},"
            " {to: d}]}\n  b: {time: 10 ms}\n  c: {time: 10 ms, next: end}\n"
            "  d: {time: 10 ms, next: a, attempts: 2}\n",
            "adac",
        ),
        # A repeat is no attempt, and begins anew when the stage is come to again.
        (
            "  a: {time: 20 ms, repeat: 2, attempts: 2}\n"
            "  b: {time: 10 ms, next: [{when: clock < 55 ms, to: a}, end]}\n",
            "aabaab",
        ),
        # A failure does not wait for the repeats.
        (
            "  a: {time: 20 ms, repeat: 4, fail_if: a.visits >= 2, on_fail: b}\n"
            "  b: {time: 10 ms}\n",
            "aab",
        ),
        (
            "  a: {until: clock > 20 ms, within: 1 s, next: [{when: speed > 1 m/s, to: c}, b]}\n"
            "  c: {time: 10 ms}\n  b: {time: 10 ms}\n",
            "ab",
        ),
    ],
)
def test_the_way_through_the_stages(stages, expected):
    assert way(stages) == (list(expected), "done")


def test_attempts_count_what_is_no_repeat():
    found, status = way("  a: {time: 20 ms, repeat: 2, attempts: 2}\n  b: {time: 10 ms, next: a}\n")
    assert [key for key, _ in itertools.groupby(found)] == ["a", "b", "a", "b"]
    assert (len(found), status) == (6, "failed")


@pytest.mark.parametrize(
    ("stages", "circle"),
    [
        ("a: {time: 1 s, next: [{when: a.visits < 4, to: a}, end]}", False),
        ("a: {time: 1 s, next: [{when: a.visits <= 4 and t > 0 s, to: a}, end]}", False),
        ("a: {time: 1 s, next: [{when: a.visits > 4, to: a}, end]}", True),
        ("a: {time: 1 s, next: [{when: a.visits < 4 or t > 0 s, to: a}, end]}", True),
        ("a: {time: 1 s, next: [{when: not (a.visits < 4), to: a}, end]}", True),
        ("a: {time: 1 s}\n  b: {time: 1 s, next: [{when: a.visits < 4, to: b}, end]}", True),
        ("a: {time: 1 s}\n  b: {time: 1 s, next: [{when: a.visits < 4, to: a}, end]}", False),
        (
            "a: {time: 1 s}\n  b: {time: 1 s, next: [{when: t > 0 s, to: c}, {to: d}]}\n"
            "  c: {time: 1 s}\n  d: {time: 1 s, next: [{when: c.visits < 4, to: b}, end]}",
            True,  # past c
        ),
        (
            "a: {time: 1 s}\n  b: {time: 1 s}\n"
            "  c: {time: 1 s, next: [{when: b.visits < 4, to: a}, end]}",
            False,
        ),
    ],
)
def test_only_what_bounds_a_circle_needs_no_attempts(stages, circle):
    try:
        load_text(HEAD + f"  {stages}\n", "t")
        codes = set()
    except SpecError as error:
        codes = {d.code for d in error.diagnostics}
    assert codes == ({"TS604"} if circle else set())
