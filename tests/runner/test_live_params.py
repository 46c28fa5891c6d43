"""Params that are set while a stage runs: bounded, recorded, the same in both loops."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Sequence
from contextlib import closing
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from taskspec.compiler import compile_unchecked
from taskspec.motion.profile import RISE_TIME
from taskspec.program.program import Program
from taskspec.program.reference.slowed_path import LAG
from taskspec.spec import load_text
from taskspec_runner import run
from taskspec_runner.cli import app
from taskspec_runner.errors import InputError
from taskspec_runner.loop.assembly import assemble
from taskspec_runner.loop.fixed_step import INTERPRETED, NATIVE, PYTHON, Steps
from taskspec_runner.loop.fixed_step import run as simulate
from taskspec_runner.loop.live_schedule import read_move, scheduled
from taskspec_runner.record.history import History
from taskspec_runner.record.layout import LogLayout
from taskspec_runner.record.log import Log
from taskspec_runner.record.rows import RowKeeper

TASK = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 302 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m, friction: 0.2}}
params:
  press: {value: 12 N, live: 5..20 N, rate: 10 N/s}
  half: press / 2
  side: {value: 0, live: -20..20 mm, rate: 20 mm/s}
  soft: {value: 800 N/m, live: +- 50 %}
  pace: {value: 20 mm/s, live: 5..40 mm/s, rate: 50 mm/s^2}
law: {kind: impedance, stiffness: {x: soft, y: soft, z: 1000 N/m}}
stages:
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -half, within: {time: 2 s}}
  press: {axes: {z: {force: -press}, x: {position: 500 mm + side}}, time: 1.5 s}
  slide:
    axes: {z: {force: -press}}
    path: {to: [510 mm, 20 mm, 300 mm], speed: pace}
    within: {time: 20 s}
expect:
  - max(norm(force)) < press + 15 N
  - press.force.z within -press +- 12 N
"""
PERIOD = 1e-3
MOVES = (
    "side = 10 mm @ 1 s",
    "press = 8 N @ 0.0095 s",
    "press = 15 N @ 1.2 s",
    "soft = 500 N/m @ 1.1 s",
    "press = 6 N @ 1.7 s",
    "pace = 40 mm/s @ 2.2 s",
    "press = 2 * half @ 2.5 s",
)


@cache
def program(text: str = TASK) -> Program:
    return compile_unchecked(load_text(text, "task"))


def recorded(lines: Sequence[str], loop: str | None = None, text: str = TASK) -> History:
    """Every tick of a run with some moves."""
    compiled = program(text)
    parts = assemble(compiled)
    keeper, task = RowKeeper(parts.bus), compiled.context.loaded.task
    simulate(
        parts.machine,
        parts.plant,
        parts.bus,
        keeper,
        compiled.context.period,
        loop=loop,
        hand=scheduled(lines, task, compiled.context.period),
    )
    return keeper.history(LogLayout.of(compiled, task), compiled.stages)


def logged(lines: Sequence[str], folder: Path, loop: str) -> bytes:
    """What a run with some moves writes, with its changes of stage."""
    folder.mkdir()
    compiled, path = program(), folder / "log.arrow"
    parts = assemble(compiled)
    with closing(parts.recorder(Log(path))) as recorder:
        outcome = simulate(
            parts.machine,
            parts.plant,
            parts.bus,
            recorder,
            compiled.context.period,
            loop=loop,
            hand=scheduled(lines, compiled.context.loaded.task, compiled.context.period),
        )
    assert (outcome.status, outcome.loop) == ("done", NATIVE if loop != PYTHON else PYTHON)
    return path.read_bytes() + repr(parts.machine.transitions).encode()


def test_the_loops_write_the_same_bytes(tmp_path: Path) -> None:
    native = logged(MOVES, tmp_path / "native", NATIVE)
    assert native == logged(MOVES, tmp_path / "interpreted", INTERPRETED)
    assert native == logged(MOVES, tmp_path / "python", PYTHON)
    assert native != logged(MOVES[:-1], tmp_path / "other", NATIVE)


@pytest.mark.parametrize("loop", [NATIVE, PYTHON])
def test_an_owner_sets_what_a_schedule_sets(loop: str, tmp_path: Path) -> None:
    folder = tmp_path / "steps"
    folder.mkdir()
    compiled, path = program(), folder / "log.arrow"
    task, period = compiled.context.loaded.task, compiled.context.period
    moves = sorted((read_move(each, task) for each in MOVES), key=lambda move: move.tick(period))
    parts = assemble(compiled)
    with closing(parts.recorder(Log(path))) as recorder:
        steps = Steps(parts.machine, parts.plant, parts.bus, recorder, period, loop=loop)
        for most in itertools.cycle((1, 20, 7)):
            while moves and moves[0].tick(period) == steps.ticks:
                move = moves.pop(0)
                assert parts.machine.live.set(move.name, move.value) == move.value
            until = moves[0].tick(period) - steps.ticks if moves else most
            steps.advance(min(most, until))
            if steps.outcome is not None:
                break
    assert not moves
    mine = path.read_bytes() + repr(parts.machine.transitions).encode()
    assert mine == logged(MOVES, tmp_path / "run", loop)


def test_a_value_goes_to_its_target_at_its_rate() -> None:
    history = recorded(["press = 15 N @ 0.5 s", "press = 9 N @ 0.6 s", "soft = 500 N/m @ 0.7 s"])
    clock, press = history.columns["clock"], history.columns["param.press"]
    # From 12 N up by 10 N/s for 0.1 s, then down to 9 N: 13 N at the tick before the second move.
    since = np.clip(clock - 0.499, 0, 0.1)
    after = np.clip(clock - 0.599, 0, 0.4)
    assert press == pytest.approx(12 + 10 * since - 10 * after, abs=1e-9)
    assert history.units["param.press"] == "N"
    steps = np.abs(np.diff(press))
    # A tick's step is rate times period; the values of both have rounding errors of 15 N.
    assert steps.max() <= 10 * PERIOD + 4 * np.spacing(15.0)
    assert (steps > 0.99 * 10 * PERIOD).sum() == 500
    assert press[-1] == 9.0
    soft = history.columns["param.soft"]
    assert soft[clock < 0.7 - PERIOD / 2].tolist() == [800.0] * 700
    assert set(soft[clock > 0.7 - PERIOD / 2].tolist()) == {500.0}


def test_what_nobody_sets_stays_as_declared() -> None:
    still = TASK
    for live, plain in (
        ("{value: 12 N, live: 5..20 N, rate: 10 N/s}", "12 N"),
        ("{value: 0, live: -20..20 mm, rate: 20 mm/s}", "0 mm"),
    ):
        assert live in still
        still = still.replace(live, plain)
    mine, theirs = recorded([]), recorded([], text=still)
    assert len(mine) == len(theirs)
    # The same numbers in functions that fold constants otherwise.
    for name in ("position.x", "force.z", "joint.1.position", "joint.7.torque"):
        assert mine.columns[name] == pytest.approx(theirs.columns[name], abs=1e-9), name


def test_a_moved_position_is_a_motion_with_its_velocity() -> None:
    """The ramp of a live param, beside the same written as an expression of time."""
    moving = recorded(["side = 10 mm @ 1 s"])
    rows = moving.window("press")
    # It knows of the move from the tick at 1 s on, in which it has gone on for a period.
    away = 1 - PERIOD
    ramp = f"500 mm + clamp(20 mm/s * (clock - {away!r} s), 0, 10 mm)"
    written = TASK.replace("{position: 500 mm + side}", f"{{position: '{ramp}'}}")
    beside = recorded([], text=written)
    assert len(moving) == len(beside)
    # At its two corners a rate has either value, which moves nothing by more than rate and period.
    for name, near in (("position.x.ref", 1e-12), ("position.x", 0.02 * PERIOD)):
        mine, theirs = moving.columns[name][rows], beside.columns[name][rows]
        assert mine == pytest.approx(theirs, abs=near), name
    apart = np.abs(moving.columns["velocity.x.ref"] - beside.columns["velocity.x.ref"])[rows]
    assert (apart > 1e-9).sum() <= 2
    rate = moving.columns["velocity.x.ref"][rows]
    t = moving.columns["clock"][rows]
    on_its_way = (t > away + 0.01) & (t < away + 0.49)
    assert on_its_way.sum() > 400
    assert rate[on_its_way] == pytest.approx(0.02, abs=1e-9)


def test_a_force_that_is_set_is_reached_across_a_change_of_stage() -> None:
    history = recorded(["press = 16 N @ 1.7 s"])
    press, wanted = history.columns["param.press"], history.columns["force.z.ref"]
    sliding = history.window("slide")
    first = int(np.flatnonzero(sliding)[0])
    assert 12.0 < press[first] < 16.0
    assert press[first] - press[first - 1] == pytest.approx(10 * PERIOD, rel=1e-9)
    # The stage rises from what it measures to the set point, which goes on meanwhile.
    late = sliding & (history.columns["t"] > 0.3)
    assert wanted[late] == pytest.approx(-press[late], abs=1e-12)
    assert history.columns["force.z"][-1] == pytest.approx(-16.0, rel=0.02)


def test_a_set_point_that_is_lowered_is_no_overshoot_of_the_first_one(tmp_path: Path) -> None:
    """It went from 12 N to 8 N: what counts is how far below 8 N it was."""
    text = TASK.replace("time: 1.5 s", "time: 2.5 s")
    ran = run(load_text(text, "task"), tmp_path / "run", live=["press = 8 N @ 1.5 s"], report=False)
    found = ran.summary["responses"]["press"]["force.z"]
    rows = ran.history.window("press") & (ran.history.columns["clock"] > 1.5)
    beyond = float((ran.history.columns["force.z"][rows] + 8.0).max())
    assert found["set_point"] == pytest.approx(-8.0)
    assert found["step"] == pytest.approx(4.0, abs=0.2)
    assert found["overshoot"] == pytest.approx(max(beyond, 0.0), abs=1e-9)
    assert found["overshoot"] < 0.5
    # At 10 N/s it is on its way for 0.4 s.
    assert 0.3 < found["settling_time"] < 0.7


def test_a_gain_that_is_set_is_the_law_s() -> None:
    history = recorded(["soft = 500 N/m @ 1.1 s"])
    assert history.columns["gain.stiffness.x"] == pytest.approx(history.columns["param.soft"])
    assert {500.0, 800.0} == set(history.columns["gain.stiffness.x"].tolist())


def path_lasts(share: float) -> float:
    """How long a path of 10 by 20 mm takes at a share w of its greatest speed V = 40 mm/s [s].

    By its own time, of which w pass in a second, it takes L/V + T, T of rising and braking. It
    begins at the share 1, which falls by 1/T down to w + T_u/T and then as exp(-t/T_u).
    """
    near = LAG / RISE_TIME
    ahead = ((1 - share) ** 2 - near**2) * RISE_TIME / 2 + near * LAG
    return (math.hypot(0.01, 0.02) / 0.04 + RISE_TIME - ahead) / share


def test_a_speed_that_is_set_slows_the_path() -> None:
    slow, fast = recorded(["pace = 5 mm/s @ 1 s"]), recorded([])
    more = float(slow.columns["clock"][-1] - fast.columns["clock"][-1])
    # The share is integrated by ticks, and the end of each path is a tick.
    assert more == pytest.approx(path_lasts(1 / 8) - path_lasts(1 / 2), abs=5 * PERIOD)


def test_a_guard_goes_by_the_value_of_its_tick() -> None:
    for moves, rate in (([], 0.0), (["press = 8 N @ 0 s"], 10.0)):
        history = recorded(moves)
        approach = history.window("approach")
        first = int(np.flatnonzero(~approach)[0])
        force, half = history.columns["force.z.measured"], history.columns["param.press"] / 2
        assert not (force[:first] < -half[:first]).any()
        assert force[first] < -half[first]
        assert half[first] == pytest.approx((12 - rate * first * PERIOD) / 2, abs=1e-9)


def test_values_beyond_the_bounds_are_the_nearest_within() -> None:
    parts = assemble(program())
    live = parts.machine.live
    assert live.names == ("press", "side", "soft", "pace")
    assert live.set("press", 30.0) == 20.0
    assert live.set("press", -math.inf) == 5.0
    assert (live["press"], live.target("press")) == (12.0, 5.0)
    assert live.start("press", 7.0) == 7.0
    assert (live["press"], live.target("press")) == (7.0, 7.0)
    with pytest.raises(ValueError, match="not a number"):
        live.set("press", math.nan)
    with pytest.raises(KeyError, match="did you mean 'press'"):
        live.set("pres", 8.0)


def test_a_run_says_what_was_set_and_can_be_made_again(tmp_path: Path) -> None:
    task = load_text(TASK, "task")
    first = run(task, tmp_path / "first", live=MOVES, report=False)
    lines = json.loads((first.folder / "manifest.json").read_text())["live"]
    assert len(lines) == len(MOVES)
    assert lines[0] == "press = 8.0 N @ 0.0095 s"
    again = run(task, tmp_path / "again", live=lines, report=False)
    assert (again.folder / "log.arrow").read_bytes() == (first.folder / "log.arrow").read_bytes()
    assert first.history.columns["param.press"].max() == pytest.approx(13.0)
    assert [each.passed for each in first.expectations] == [True, True]


def test_an_expectation_is_judged_by_the_value_of_each_tick(tmp_path: Path) -> None:
    text = TASK.replace("- press.force.z within -press +- 12 N", "- min(press) > 7 N")
    task = load_text(text.replace("- max(norm(force)) < press + 15 N\n", ""), "task")
    low = run(task, tmp_path / "low", live=["press = 6 N @ 1 s"], report=False)
    high = run(task, tmp_path / "high", report=False)
    assert [each.passed for each in low.expectations] == [False]
    assert [each.passed for each in high.expectations] == [True]


def test_a_move_after_the_end_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "task.yaml"
    path.write_text(TASK, encoding="utf-8")
    lines = ["--live", "press = 8 N @ 100 s", "--live", "press = 9 N @ 1 s"]
    with pytest.raises(SystemExit):
        app(["run", str(path), "--out", str(tmp_path / "out"), *lines])
    said = capsys.readouterr().err
    assert "--live 'press = 8.0 N @ 100.0 s' was not made: the run was over before" in said
    assert "press = 9" not in said


def test_a_last_value_is_compared_with_what_was_set_then(tmp_path: Path) -> None:
    text = TASK.replace(
        "- press.force.z within -press +- 12 N",
        "- last(press.force.z) within -press +- 1 N\n  - last(press.force.z) < -press + 1 N\n"
        "  - max(press.force.z) < -press + 1 N",
    )
    moved = run(load_text(text, "task"), tmp_path, live=["press = 8 N @ 1 s"], report=False)
    by = {each.text: each.passed for each in moved.expectations}
    assert by["last(press.force.z) within -press +- 1 N"] is True
    assert by["last(press.force.z) < -press + 1 N"] is True
    # No tick's value belongs to a greatest one: each is compared with it.
    assert by["max(press.force.z) < -press + 1 N"] is False


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("pres = 8 N @ 1 s", "did you mean 'press'"),
        ("half = 8 N @ 1 s", "it follows from press"),
        ("press = 8 mm @ 1 s", "a force (N) is needed here"),
        ("press = 80 N @ 1 s", "'press' may be 5 N to 20 N"),
        ("press = 8 N @ -1 s", "a run begins at 0 s"),
        ("press = 8 N @ 1 N", "a time (s) is needed here"),
        ("press = 8 N", "such as 'press = 8 N @ 1 s'"),
        ("press @ 1 s", "such as 'press = 8 N @ 1 s'"),
        ("press = 8 N/0 @ 1 s", "is not a force"),
        ("press = (8 N @ 1 s", "--live 'press = (8 N @ 1 s'"),
    ],
)
def test_a_line_that_sets_nothing_is_refused(line: str, text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError) as raised:
        run(load_text(TASK, "task"), tmp_path / "run", live=[line])
    assert text in str(raised.value)
    assert not (tmp_path / "run").exists()


def test_a_param_that_is_fixed_says_how_it_would_be_live() -> None:
    text = TASK.replace("half: press / 2", "half: press / 2\n  size: 3 mm")
    with pytest.raises(InputError, match=r"its value is fixed; write size: \{value: \.\., live"):
        read_move("size = 1 mm @ 1 s", load_text(text, "task").task)
