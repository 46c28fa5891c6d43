"""Each end of a trial: its code, its place, when it was, and its cause."""

from __future__ import annotations

import re

import numpy as np
import pytest
from trials import checked, found, place_of, serious

from taskspec.compiler import admit
from taskspec.text.diagnostic import Severity
from taskspec_runner.trial.causes import blow
from taskspec_runner.trial.moment import Moment
from taskspec_runner.trial.trial import MOST_PASSED, OPEN, trial, trials_past_limits

HEAD = """\
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 340 mm]}}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], stiffness: 20 kN/m}}
frame: table
"""
TOUCH = "  touch: {axes: {z: {velocity: -20 mm/s}}, until: force.z < -2 N, within: {time: 4 s}}\n"
DRAWER = """\
taskspec: 1
robot: {model: panda, grasp: drawer.handle}
world:
  drawer: {mechanism: slide, xyz: [600 mm, 0, 400 mm], rpy: [0, -90 deg, 0], stop: 0..200 mm}
frame: drawer.handle
limits: {force: 40 N}
stages:
"""
BESIDE = """\
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 340 mm]}}
world: {block: {shape: box, xyz: [500 mm, 200 mm, 300 mm], size: [100 mm, 100 mm, 60 mm]}}
"""
CRANK = """\
taskspec: 1
name: a
robot: {model: panda, grasp: crank.handle}
world:
  crank:
    {mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0], knob: free,
     inertia: 0.05 kg*m^2, damping: 0.2 N*m*s/rad}
frame: crank
limits: {force: 40 N, torque: 5 N*m, speed: 250 mm/s}
stages:
  rotate:
    axes:
      {x: {force: 0}, z: {force: 0}, rx: {torque: 0}, ry: {torque: 0}, rz: {hold: world},
       y: {velocity: 100 mm/s}}
    until: crank.angle > 1 turn
    within: {time: 20 s}
"""
GIVES = "x: {force: 0}, y: {force: 0}, rx: {torque: 0}, ry: {torque: 0}, rz: {torque: 0}"


def tried(stages: str, *, head: str = HEAD, touch: bool = True) -> str:
    return f"{head}stages:\n{TOUCH if touch else ''}{stages}"


#: By name: the file, the code, what of which line is pointed at, the cause.
ENDS = {
    "force": (
        tried(
            "  press: {axes: {z: {force: -12 N}}, time: 1 s}\n",
            head=HEAD + "limits: {force: 8 N}\n",
        ),
        "TS616", (8, "z"), "limit on force: 8 N", "N are commanded there",
    ),
    "own limit on force": (
        tried("  press: {axes: {z: {force: -12 N}}, time: 1 s, limits: {force: 8 N}}\n"),
        "TS616", (7, "8 N"), "limit on force: 8 N", "N are commanded there",
    ),
    "motion into a contact": (
        tried("  down: {axes: {z: {velocity: -20 mm/s}}, time: 2 s}\n",
              head=HEAD + "law: impedance\nlimits: {force: 15 N}\n"),
        "TS616", (9, "z"), "limit on force: 15 N", "'z' is motion-controlled",
    ),
    "speed": (
        tried("  up: {axes: {z: {move: 80 mm, speed: 200 mm/s}}}\n",
              head=HEAD + "limits: {speed: 150 mm/s}\n", touch=False),
        "TS426", (7, "z"), "limit on speed: 150 mm/s", "the reference goes with 15",
    ),
    "joint velocity": (
        tried("  across: {axes: {y: {move: 300 mm, speed: 1.5 m/s}}}\n", touch=False),
        "TS424", (6, "y"), "velocity limit of joint", "the tool goes with",
    ),
    "runaway": (
        tried("  press: {axes: {z: {force: -5 N}}, time: 1 s}\n", head=BESIDE, touch=False),
        "TS424", (5, "z"), "velocity limit of joint", "nothing returns the -5 N on 'z'",
    ),
    "fail_if": (
        tried("  press: {axes: {z: {force: -12 N}}, time: 1 s, fail_if: norm(force) > 10 N}\n"),
        "TS618", (7, "norm(force) > 10 N"), "norm(force) > 10 N", "",
    ),
    "fail_if at once": (
        tried("  press: {time: 1 s, fail_if: speed >= 0}\n", touch=False),
        "TS613", (6, "speed >= 0"), "speed >= 0", "",
    ),
    "within time": (
        tried("  go: {axes: {x: {velocity: 20 mm/s}}, until: position.x > 900 mm, "
              "within: {time: 1 s}}\n",
              touch=False),
        "TS611", (6, "1 s"), "within 1 s", "`until` did not hold: position.x was 500 mm to 5",
    ),
    "within time, far off": (
        tried("  go: {axes: {z: {velocity: -20 mm/s}}, until: touching, within: {time: 1 s}}\n",
              touch=False),
        "TS617", (6, "1 s"), "within 1 s", "are left to 'table'",
    ),
    "within time, away": (
        tried("  go: {axes: {z: {velocity: 20 mm/s}}, until: touching, within: {time: 1 s}}\n",
              touch=False),
        "TS617", (6, "1 s"), "within 1 s", "it moves away from 'table'",
    ),
    "within time, still": (
        tried("  go: {until: touching, within: {time: 1 s}}\n", touch=False),
        "TS617", (6, "1 s"), "within 1 s", "it stays 40 mm off 'table'",
    ),
    "within travel": (
        tried("  go: {axes: {z: {velocity: -20 mm/s}}, until: touching, "
              "within: {time: 4 s, travel: 30 mm}}\n",
              touch=False),
        "TS617", (6, "30 mm"), "within 30 mm of travel", "10 mm are left to 'table'",
    ),
    "attempts": (
        tried("  back: {axes: {z: {move: 5 mm}}, attempts: 2, fail_if: t > 50 ms, "
              "on_fail: back}\n"),
        "TS618", (7, "back"), "", "",
    ),
    "no number": (
        tried('  go: {axes: {z: {velocity: "-20 mm/s*sqrt(1 - norm(force)/(3 N))"}}, time: 3 s}\n',
              touch=False),
        "TS621", (6, "z"), "is not a finite number", "no value there",
    ),
    "stop of a mechanism": (
        DRAWER + f"  pull: {{axes: {{z: {{velocity: 80 mm/s}}, {GIVES}}}, time: 4 s}}\n",
        "TS616", (8, "z"), "limit on force: 40 N", "'drawer' meets, with 80 mm/s, its stop, 200 mm",
    ),
    "against a mechanism": (
        CRANK, "TS616", (14, "y"), "limit on force: 40 N",
        "'crank' does not let 'y' move as it is to",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ENDS)
def test_an_end_is_reported_where_and_when_it_is_with_its_cause(name):
    text, code, place, words, cause = ENDS[name]
    finding = found(text, code)
    assert finding.severity is Severity.WARNING
    assert place_of(finding, text) == place
    assert finding.message.startswith("in the trial, stage ")
    assert re.search(r"at t = \S+ m?s \(run time \S+ m?s\): ", finding.message)
    assert words in finding.message
    assert cause in finding.message
    assert finding.hint


def test_the_time_of_an_end_is_that_of_the_trial():
    text = ENDS["own limit on force"][0]
    once = trial(admit(checked(text)))
    ended = once.transitions[-1]
    began = once.transitions[-2].clock
    message = found(text, "TS616").message
    t, clock = (float(x) for x in re.findall(r"at t = (\S+) s \(run time (\S+) s\)", message)[0])
    assert clock == pytest.approx(ended.clock, rel=1e-3)
    assert t == pytest.approx(ended.clock - began, rel=1e-2)


@pytest.mark.parametrize("speed", [40, 80, 150])
@pytest.mark.parametrize("stiffness", [100, 200])
def test_a_blow_is_the_measured_peak(speed, stiffness):
    """v sqrt(k m) beside the peak of a trial without a limit, the contact undamped: 10 %.

    On softer contacts the reference goes on by more while the blow lasts, and adds to it.
    """
    text = (HEAD.replace("stiffness: 20 kN/m", f"stiffness: {stiffness} kN/m, damping: 0")
            + f"stages:\n  touch: {{axes: {{z: {{velocity: -{speed} mm/s}}}}, "
            "until: force.z < -1 N for 30 ms, within: {time: 3 s}}\n")  # fmt: skip
    once = trial(admit(checked(text)))
    visit = next(iter(once.history.visits()))
    force = -once.history.columns["force.z"][visit.rows]
    first = int(np.argmax(force > 0))
    peak = first + int(np.argmax(force[first : first + 100]))
    cause = blow(Moment(once, visit, peak))
    assert cause is not None
    (reported,) = re.findall(r"make of that about (\S+) N", cause.text)
    assert float(reported) == pytest.approx(force[peak], rel=0.1)
    assert f"'table' with {speed}" in cause.text


def test_a_limit_is_passed_and_what_comes_after_it_is_reported_too():
    text = tried(
        "  press: {axes: {z: {force: -12 N}}, time: 1 s, limits: {force: 8 N}}\n"
        "  up: {axes: {z: {move: 30 mm}}}\n"
        "  again:\n    axes: {z: {velocity: -150 mm/s}}\n    until: force.z < -2 N for 20 ms\n"
        "    within: {time: 2 s}\n    limits: {force: 15 N}\n"
        "  wait: {time: 1 s}\nexpect:\n  - last(wait.position.z) > 200 mm\n"
    )
    assert sorted(serious(text)) == ["TS610", "TS616", "TS616", "TS726"]
    press, again = (each for each in checked(text).findings if each.code == "TS616")
    assert "stage 'press' stops the run" in press.message
    assert "stage 'again' stops the run" in again.message
    assert "'table' with 15" in again.message
    passed = re.search(r"without the limit it comes to (\S+) N", press.message)
    assert passed
    assert float(passed[1]) > 11.5
    trials = trials_past_limits(admit(checked(text)), None, 100_000)
    assert [each.limit for each in trials] == ["force", "force", ""]
    assert trials[-1].outcome.status == "done"
    # Up to the limit the ticks are the same.
    until = trials[0].outcome.ticks - 1
    for column in ("position.z", "force.z", "joint.4.torque"):
        first, last = (each.history.columns[column] for each in (trials[0], trials[-1]))
        assert np.array_equal(first[:until], last[:until])


def test_only_so_many_limits_are_passed():
    stages = "".join(
        f"  up{i}: {{axes: {{z: {{move: {20 * (-1) ** i} mm, speed: 100 mm/s}}}}}}\n"
        for i in range(6)
    )
    text = tried(stages, head=HEAD + "limits: {speed: 80 mm/s}\n", touch=False)
    trials = trials_past_limits(admit(checked(text)), None, 100_000)
    assert len(trials) == MOST_PASSED + 1
    assert [each.limit for each in trials] == ["speed"] * (MOST_PASSED + 1)
    assert serious(text).count("TS426") == MOST_PASSED + 1


def test_a_bound_on_ticks_ends_a_trial_and_nothing_is_reported_of_it():
    text = tried("  wait: {time: 1 s}\n", touch=False)
    once = trial(admit(checked(text)), ticks=100)
    assert once.outcome.status == OPEN
    assert 100 <= once.outcome.ticks < 1000
    assert len(trials_past_limits(admit(checked(text)), None, 100)) == 1


def test_a_good_file_has_no_warnings():
    text = tried(
        "  press: {axes: {z: {force: -10 N}}, time: 2 s}\n  leave: {axes: {z: {move: 30 mm}}}\n"
        "expect:\n  - last(press.force.z) within -10 N +- 0.5 N\n",
        head=HEAD + "limits: {force: 40 N}\n",
    )
    assert checked(text).findings == ()


def test_what_is_only_predicted_is_a_remark_where_the_trial_ends_well():
    text = tried("  down: {axes: {z: {move: -50 mm}}}\n", touch=False)
    finding = found(text, "TS321")
    assert finding.severity is Severity.INFO
    bad = text.replace("frame: table\n", "frame: table\nlimits: {force: 10 N}\n")
    assert found(bad, "TS321").severity is Severity.WARNING


@pytest.mark.parametrize(
    ("sensor", "guard", "cause"),
    [
        ("{bias: [0, 0, -3 N, 0, 0, 0]}", "force.z < -2 N for 10 ms", "a declared bias of 3 N"),
        ("{noise: 0.5 N}", "force.z < -1 N", "noise has a standard deviation of 0.5 N"),
    ],
)
def test_a_guard_that_holds_in_the_air_has_the_sensors_error_as_its_cause(sensor, guard, cause):
    head = HEAD.replace("340 mm]}}", "340 mm]}, sensor: " + sensor + "}")
    text = tried(
        f"  touch: {{axes: {{z: {{velocity: -20 mm/s}}}}, until: {guard}, "
        "within: {time: 4 s}}\n",
        head=head,
        touch=False,
    )
    finding = found(text, "TS614")
    assert place_of(finding, text) == (6, guard)
    assert "with nothing touched" in finding.message
    assert cause in finding.message
