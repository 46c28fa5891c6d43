"""Settings tried and searched: what counts as good, whoever tries them."""

from __future__ import annotations

import math

import pytest

from taskspec.compiler import compile_unchecked
from taskspec.program.worlds import corner_count
from taskspec.spec import load_text
from taskspec_runner.errors import InputError
from taskspec_runner.sweep.engine import processes
from taskspec_runner.tune.evaluation import ALIKE, Key, Question, Trials, evaluate
from taskspec_runner.tune.gains import knobs_of
from taskspec_runner.tune.search import Searcher
from taskspec_runner.tune.tuned import Wanted, tune
from tune.tasks import PRESS

SLOW = PRESS.replace("law: hybrid ", "law: {kind: hybrid, force: {integral: 3 /s}} ")
WILD = PRESS.replace(
    "law: hybrid ", "law: {kind: hybrid, force: {integral: 400 /s, damping: 80 N*s/m}} "
)


def question(text: str, trials: Trials = Trials(True, 2, 0)) -> Question:  # noqa: B008
    return Question(text, "press.yaml", None, {}, {}, trials)


def test_the_first_entry_that_differs_decides() -> None:
    base = Key(0.0, 0.0, 0.0, 0.2, 0.5)
    assert Key(0.0, 0.0, 0.0, 0.2 + 2 * ALIKE, 0.1).better(base)
    assert not Key(0.0, 0.0, 0.0, 0.2 + ALIKE / 2, 0.5).better(base)
    assert base.better(Key(0.0, -0.1, 0.0, 0.9, 0.9))
    assert base.better(Key(-1.0, 0.0, 0.0, 0.9, 0.9))
    assert not Key(-1.0, -math.inf, -1.0, -math.inf, -math.inf).better(base)


def test_a_loop_that_is_unstable_in_a_world_refuses_gains_before_any_run() -> None:
    found = evaluate(question(WILD))
    assert not found.good
    assert not found.rows
    assert any("'press'" in text and "z" in text for text in found.against), found.against


def test_gains_that_are_slow_miss_in_worlds_that_are_soft() -> None:
    found = evaluate(question(SLOW))
    assert found.whole
    assert not found.good
    assert found.key.missing < 0
    assert len(found.rows) == corner_count(compile_unchecked(load_text(SLOW, "p")).context) + 2


def test_what_cannot_beat_a_rival_is_broken_off() -> None:
    asked = question(SLOW)
    rival = Key(0.0, 0.0, 0.0, 0.9, 0.9)
    broken = evaluate(
        Question(asked.text, asked.name, None, {}, {}, asked.trials, (0, 1, 2), rival)
    )
    assert not broken.whole
    assert len(broken.rows) == 1


@pytest.fixture(scope="module")
def tuned():  # type: ignore[no-untyped-def]
    program = compile_unchecked(load_text(SLOW, "press.yaml"))
    wanted = Wanted(("force.integral", "force.damping"), randoms=1, fresh=8, most=12)
    return tune(program, wanted)


def test_gains_are_found_that_succeed_in_fresh_worlds(tuned) -> None:  # type: ignore[no-untyped-def]
    assert not tuned.before.good
    assert tuned.good
    assert tuned.overrides
    assert tuned.verified[0].good < tuned.verified[1].good == tuned.verified[1].of == 8
    least = {text: (before, after) for text, before, after in tuned.margins()}
    assert len(least) == 2
    assert min(after for _, after in least.values()) > min(before for before, _ in least.values())


def test_the_same_gains_are_found_by_two_processes() -> None:
    program = compile_unchecked(load_text(SLOW, "press.yaml"))
    knobs = knobs_of(program, ["force.integral"])
    start = (None,) * len(knobs)
    alone = Searcher(program, knobs, Trials(True, 0, 0)).best([start], 4)
    with processes(2) as pool:
        both = Searcher(program, knobs, Trials(True, 0, 0), pool).best([start], 4)
    assert alone.setting == both.setting
    assert alone.setting != start
    assert alone.evaluation.key == both.evaluation.key


def test_the_interval_in_the_way_is_named_with_how_far_it_would_do() -> None:
    """No loop keeps a force on a table that may lie below the travel of its approach.

    The tool begins 3 mm above a table that the approach finds within 12 mm: 9 mm lower is too far,
    whatever the gains are, and the file's guard ends the run.
    """
    text = (
        PRESS.replace("[0, 0, +- 1 mm]", "[0, 0, +- 14 mm]")
        .replace("xyz: [500 mm, 0, 303 mm]", "xyz: [500 mm, 0, 318 mm]")
        .replace("travel: 12 mm", "travel: 22 mm")
        .replace("time: 1 s", "time: 2 s")
    )
    program = compile_unchecked(load_text(text, "press.yaml"))
    found = tune(program, Wanted(("force.integral",), randoms=0, fresh=4, most=1))
    assert not found.good
    assert found.verified is None
    height = next(each for each in found.obstacles if each.interval.name == "world.table.xyz.z")
    assert height.works is not None
    low, high = height.works
    # 18 mm less the radius of none: the tip is a sphere of which 318 mm is the lowest point's.
    assert high == pytest.approx(14e-3)
    assert -14e-3 < low < 0
    assert any("approach" in text for text in height.fails)
    others = [each for each in found.obstacles if each is not height]
    assert others
    assert all(each.works is None for each in others)


def test_a_task_that_expects_nothing_is_an_error() -> None:
    program = compile_unchecked(load_text(PRESS[: PRESS.index("expect:")], "press.yaml"))
    with pytest.raises(InputError, match="expects nothing"):
        tune(program, Wanted())


def test_a_gain_that_no_law_has_is_an_error() -> None:
    program = compile_unchecked(load_text(PRESS, "press.yaml"))
    with pytest.raises(InputError, match="has a gain named dumping; it has bandwidth"):
        tune(program, Wanted(("dumping",)))
