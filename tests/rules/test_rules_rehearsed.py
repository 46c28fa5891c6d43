"""What a task is predicted to come to when it is run ahead, against its run."""

from __future__ import annotations

from pathlib import Path

import pytest
from taskspec.foresight.doubts import doubted
from taskspec.rules.predicted_forces import close_calls

import taskspec_runner
from taskspec.analysis import rehearsal
from taskspec.examination import examine
from taskspec.spec import load_text
from taskspec.text.diagnostic import Diagnostic

#: Where `search` ends nobody knows, so nor does where `home` begins.
HOME = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 304 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m, damping: 30 N*s/m}}
frame: world
law: hybrid
limits: {force: 40 N, speed: MOST}
stages:
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -1 N, within: 3 s}
  search:
    axes: {z: {force: -8 N}, x: {velocity: 20 mm/s}}
    until: t > 0.3 s and speed > 5 mm/s
    within: {time: 1 s}
  leave: {axes: {z: {move: 20 mm}}}
  home: {path: {joints: [0, -50 deg, 0, -130 deg, 0, 90 deg, 45 deg], speed: 50 deg/s}}
expect: []
"""
RAIL = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 300 mm]}}
world: {level: {equation: "z = 300 mm", stiffness: 6 kN/m}}
frame: world
law: hybrid-reaction
limits: {force: 30 N}
stages:
  go: {axes: {x: {move: 20 mm}}}
  home: {path: {joints: [0, -50 deg, 0, -130 deg, 0, 90 deg, 45 deg], time: 3 s}}
expect: []
"""
WALL = """
taskspec: 1
robot: {model: planar3, start: {xyz: [348 mm, 20 mm, 0], rpy: [0, 0, 13 deg]}}
world: {wall: {shape: plane, xyz: [352 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 5 kN/m}}
frame: world
law: hybrid
limits: {force: MOST}
stages:
  approach: {axes: {x: {velocity: 20 mm/s}}, until: force.x > 2.5 N, within: {time: 2 s}}
  leave: {axes: {x: {move: -20 mm}} TRIES}
  home: {path: {joints: [53 deg, -100 deg, 60 deg], speed: 23 deg/s}}
expect: []
"""
LAGS = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 304 mm]}}
world:
  table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 10 kN/m, damping: 30 N*s/m, friction: 0.4}
frame: world
law: {kind: impedance, stiffness: {linear: 800 N/m}}
limits: {deviation: MOST}
stages:
  approach: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -1 N, within: 3 s}
  slide: {axes: {z: {force: -12 N}, x: {velocity: 30 mm/s}}, time: 0.8 s}
expect: []
"""
LEVER = """
taskspec: 1
robot: {model: ur5e, grasp: part.handle, start: {rpy: [180 deg, -30 deg, 0]}}
world:
  part: {mechanism: screw, xyz: [379 mm, 66 mm, 406 mm], pitch: 3.6 mm/turn, mass: 0.4 kg,
         inertia: 0.013 kg*m^2, damping: 0.034 N*m*s/rad, friction: 0.12 N*m,
         handle: [91 mm, 0, 0], knob: fixed}
frame: part
law: hybrid-reaction
stages:
  go:
    axes: {x: {force: 0}, y: {force: 0}, z: {follows: part}, rx: {torque: 0}, ry: {torque: 0},
           rz: {velocity: MOST}}
    time: 2 s
expect: ["max(norm(go.force)) < 40 N"]
"""
SWINGS = """
taskspec: 1
robot: {model: planar3, tool: {radius: 11 mm, mass: 320 g},
        start: {xyz: [348 mm, 20 mm, 0], rpy: [0, 0, 13 deg]}}
world:
  wall: {shape: plane, xyz: [352 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 120 kN/m,
         damping: 55 N*s/m, friction: 0.35}
frame: world
law: hybrid-multipliers
control: {rate: 250 Hz}
stages:
  approach: {axes: {x: {velocity: 20 mm/s}}, until: force.x > 2.5 N, within: {time: 2 s}}
  press:
    axes: {x: {force: 29 N + 8.7 N * sin(2*pi*t/(1.8 s))}, rz: {move: -7 deg}}
    time: 1 s
expect: ["last(press.force.x) within 29 +- MOST N"]
"""


def ahead(text: str) -> list[Diagnostic]:
    found = examine(load_text(text, "t.yaml")).findings
    return [each for each in found if "run ahead" in each.message]


def run_of(text: str, folder: Path) -> taskspec_runner.Run:
    return taskspec_runner.run(load_text(text, "t.yaml"), folder, report=False, force=True)


@pytest.mark.parametrize(
    ("text", "limit", "stage", "code", "reason"),
    [
        (HOME, "383 mm/s", "home", "TS420", "speed"),
        (RAIL, "", "home", "TS616", "force"),
        (WALL.replace("TRIES", ""), "60 N", "home", "TS616", "force"),
        (LAGS, "4 mm", "slide", "TS420", "deviation"),
    ],
    ids=["speed of joints", "an equation pulls back", "joints into a wall", "friction"],
)
def test_a_limit_is_passed_where_it_was_run_ahead_to_be(text, limit, stage, code, reason, tmp_path):
    """At the same time, which both plants agree on to a few periods."""
    text = text.replace("MOST", limit)
    (found,) = ahead(text)
    run = run_of(text, tmp_path / "run")
    ending = run.summary["ending"]
    assert (ending["stage"], ending["reason"]) == (stage, reason)
    assert (found.code, f"stage {stage!r} stops the run" in found.message) == (code, True)
    time = float(found.message.split("t = ")[1].split(" s")[0])
    assert time == pytest.approx(run.history.columns["t"][-1], abs=5e-3)


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        (HOME, "395 mm/s"),  # 384 mm/s are run ahead, and 1 % is too little room.
        (WALL.replace("TRIES", ""), "90 N"),  # 82.6 N
        (LAGS, "8 mm"),
        (LEVER, "10 deg/s"),
        (SWINGS, "5"),
    ],
    ids=["speed of joints", "joints into a wall", "friction", "a lever", "a set point that swings"],
)
def test_a_limit_that_leaves_room_is_not_reported(text, limit, tmp_path):
    text = text.replace("MOST", limit)
    assert ahead(text) == []
    assert run_of(text, tmp_path / "run").summary["exit_code"] == 0


def test_a_speed_that_leaves_less_than_a_hundredth_is_reported_as_close():
    (found,) = ahead(HOME.replace("MOST", "386 mm/s"))
    assert (found.code, "384 mm/s" in found.message) == ("TS426", True)


def test_a_way_home_into_something_says_with_which_force():
    """TS428 alone leaves open how the run ends."""
    text = WALL.replace("TRIES", "").replace("MOST", "60 N")
    codes = [each.code for each in examine(load_text(text, "t.yaml")).findings]
    (found,) = ahead(text)
    assert codes == ["TS428", "TS616"]
    assert "limit on force: 60 N (its force comes to 60 N)" in found.message
    assert "joints" in found.hint


def test_a_limit_that_leads_to_a_stage_too_often_fails(tmp_path):
    text = WALL.replace("MOST", "{max: 60 N, then: leave}").replace("TRIES", ", attempts: 2")
    (found,) = ahead(text)
    run = run_of(text, tmp_path / "run")
    assert run.summary["ending"]["reason"] == "attempts"
    assert (found.code, "stage 'home' fails" in found.message) == ("TS616", True)
    assert "stage 'leave' has had its 2 attempts" in found.message


def test_a_limit_that_leads_away_needs_no_room():
    """82.6 N come 0.5 % near to it; where they passed it, the stage that follows would go on."""
    close = WALL.replace("MOST", "83 N").replace("TRIES", "")
    leads = close.replace("83 N", "{max: 83 N, then: rest}").replace(
        "expect", "  rest: {time: 0.1 s, limits: {force: 200 N}}\nexpect"
    )
    assert [each.code for each in ahead(close)] == ["TS616"]
    assert ahead(leads) == []


def test_an_expectation_that_is_missed_leaves_open_what_comes_after():
    """The set point itself misses what is expected, and the way home is too fast all the same."""
    text = HOME.replace("MOST", "383 mm/s").replace(
        "expect: []", 'expect: ["last(press.force.z) within -12 +- 1 N"]'
    )
    press = 'press: {axes: {z: {force: "-12 N - 4 N*sin(2*pi*t/(1.4 s))"}}, time: 0.35 s}\n'
    text = text.replace("  search:", f"  {press}  search:")
    codes = sorted(each.code for each in examine(load_text(text, "t.yaml")).findings)
    assert codes == ["TS420", "TS726"]


def test_dampers_of_a_loop_without_an_integral_hold_a_lever_back(tmp_path):
    """1086 N s/m at 78 mm/s, of which the proportional loop leaves 1/1.5."""
    text = LEVER.replace("MOST", "49 deg/s")
    (found,) = ahead(text)
    assert found.code == "TS726"
    assert not run_of(text, tmp_path / "run").expectations[0].passed


def test_a_set_point_that_swings_and_cannot_be_followed_is_run_ahead(tmp_path):
    text = SWINGS.replace("MOST", "2")
    plan = examine(load_text(text, "t.yaml")).plan
    assert close_calls(plan) == {"press"}
    (found,) = ahead(text)
    assert found.code == "TS726"
    assert not run_of(text, tmp_path / "run").expectations[0].passed


def test_motion_axes_against_an_equation_that_pulls_are_in_doubt():
    """A law with multipliers leaves to it what it decides."""
    text = RAIL.replace("home: {path: {joints: [0, -50 deg, 0, -130 deg, 0, 90 deg, 45 deg], "
                        "time: 3 s}}", "back: {axes: {x: {move: -20 mm}}}")  # fmt: skip
    stiff = text.replace("hybrid-reaction", "hybrid")
    found = [[*doubted(examine(load_text(each, "t.yaml")).plan)] for each in (text, stiff)]
    assert found == [[], ["go", "back"]]


def test_a_rehearsal_that_is_broken_off_speaks_of_what_is_over(monkeypatch):
    """What the stage is about in which it was broken off, or all of the run, is left open."""
    text = SWINGS.replace("MOST", "2").replace(
        'expect: ["last', 'expect: ["max(norm(force)) < 10 N", "last'
    )
    text = text.replace("expect", "  leave: {axes: {x: {move: -20 mm}}}\nexpect", 1)
    whole = ahead(text)
    plan = examine(load_text(text, "t.yaml")).plan
    run = rehearsal.rehearsal_of(plan)
    assert [each.span.line for each in whole] == [text.count("\n")] * 2
    monkeypatch.setattr(rehearsal, "_MOST_TICKS", int(run.ticks("approach").sum()) + 300)
    (found,) = ahead(text)
    place = text.splitlines()[found.span.line - 1][
        found.span.column - 1 : found.span.end_column - 1
    ]
    assert "last(press.force.x)" in place
