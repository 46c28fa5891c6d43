"""Predicted courses of forces, and the expectations that they miss, against runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from taskspec.analysis.force_course import ForceCourses

import taskspec_runner
from taskspec.examination import examine
from taskspec.geometry.axis import Axis
from taskspec.spec import load_task, load_text

PRESS = """
taskspec: 1
robot: {{model: {arm}, start: {{xyz: [500 mm, 0, 304 mm]}}{sensor}}}
world:
  table: {{shape: plane, xyz: [0, 0, 300 mm], stiffness: {k}, damping: 30 N*s/m}}
frame: table
law: {law}
stages:
  approach: {{axes: {{z: {{velocity: -10 mm/s}}}}, until: force.z < -1 N, within: 3 s}}
  press: {{axes: {{z: {{force: -12 N}}}}, time: 0.8 s}}
  swing: {{axes: {{z: {{force: -12 N - 5 N * sin(2*pi*t/(1 s))}}}}, time: 0.5 s}}
"""
SLOW = "{kind: hybrid, force: {damping: {z: 400 N*s/m}, integral: 2.37 /s}}"
LATE = ", sensor: {delay: 3 ms, filter: 60 Hz, rate: 250 Hz}"
GO = """
taskspec: 1
robot: {{model: panda, start: {{xyz: [500 mm, 0, 400 mm]}}}}
stages:
  go: {{axes: {{x: {{velocity: {rate}}}}}, until: {until}, within: 3 s}}
expect:
  - {expect}
"""


def forced(text: str, folder: Path) -> taskspec_runner.Run:
    return taskspec_runner.run(load_text(text, "t.yaml"), folder, report=False, force=True)


@pytest.mark.parametrize(
    ("law", "arm", "k", "sensor"),
    [
        ("hybrid", "panda", "10 kN/m", ""),
        (SLOW, "panda", "10 kN/m", ""),
        ("hybrid-multipliers", "ur5e", "10 kN/m", ""),
        ("hybrid-reaction", "panda", "30 kN/m", ""),
        ("parallel", "ur5e", "10 kN/m", ""),
        ("parallel-pid", "panda", "3 kN/m", ""),
        ("hybrid", "panda", "10 kN/m", LATE),
    ],
)
def test_a_force_goes_as_predicted(law, arm, k, sensor, tmp_path):
    """The touch falls between two ticks, so the blow is off by what it rises in one: 0.1 s of it.

    After that 2 % of the set point (1.6 % measured, with the sensor that holds for four ticks); of
    the swing, which begins in contact, 0.5 %.
    """
    text = PRESS.format(law=law, arm=arm, k=k, sensor=sensor)
    plan = examine(load_text(text, "t.yaml")).plan
    history = forced(text, tmp_path / "run").history
    force = history.columns["force.z"]
    courses = ForceCourses(plan)
    for name, share in (("press", 0.02), ("swing", 0.005)):
        (visit,) = [v for v in history.visits() if v.stage == name]
        course = courses.of(name, Axis("z"))
        applied = force[visit.first : visit.last + 1][: len(course.applied)]
        late = course.times[: len(applied)] > 0.1
        off = np.abs(applied - course.applied[: len(applied)])[late]
        assert off.max() < share * 12.0, name


def test_what_is_missed_is_announced_as_measured(tmp_path):
    text = PRESS.format(law=SLOW, arm="panda", k="10 kN/m", sensor="") + (
        "expect:\n"
        "  - press.force.z within -12 +- 0.4 N for 90 %\n"
        "  - max(abs(press.force.z)) < 12.4 N\n"
        "  - last(press.force.z) within -12 +- 0.1 N\n"
        "  - max(abs(press.force.z)) < 14 N\n"
        "  - swing.force.z within swing.force.z.ref +- 2 N\n"
    )
    found = [d for d in examine(load_text(text, "t.yaml")).findings if d.code == "TS726"]
    assert len(found) == 3
    share, peak, last = (
        float(re.search(pattern, d.message)[1])
        for pattern, d in zip(
            (r"hold in (\d+) %", r"come to ([\d.]+) N", r"come to (-[\d.]+) N"),
            found,
            strict=True,
        )
    )
    history = forced(text, tmp_path / "run").history
    (visit,) = [v for v in history.visits() if v.stage == "press"]
    force = history.columns["force.z"][visit.first : visit.last + 1]
    assert share == pytest.approx(100 * np.mean(np.abs(force + 12) < 0.4), abs=3)
    assert peak == pytest.approx(np.abs(force).max(), rel=0.01)
    assert last == pytest.approx(force[-1], rel=0.01)


@pytest.mark.parametrize(
    ("rate", "until", "expect", "short"),
    [
        ("50 mm/s", "travel > 60 mm", "last(go.travel) > 60 mm", True),
        ("50 mm/s", "travel > 60 mm", "last(go.travel) > 59 mm", False),
        ("-50 mm/s", "position.x < 480 mm", "last(go.position.x) < 480 mm", True),
        ("-50 mm/s", "position.x < 480 mm", "last(go.position.x) < 481 mm", False),
        ("50 mm/s", "position.x > 20 mm", "last(go.position.x) > 20 mm", False),
    ],
)
def test_a_guard_ends_short_of_what_it_waits_for(rate, until, expect, short, tmp_path):
    text = GO.format(rate=rate, until=until, expect=expect)
    assert ("TS727" in {d.code for d in examine(load_text(text, "t.yaml")).findings}) is short
    run = forced(text, tmp_path / "run")
    assert (run.summary["expectations"][0]["passed"]) is not short


VALVE = """
taskspec: 1
robot: {{model: panda, grasp: valve.handle, start: {{rpy: [180 deg, 0, 90 deg]}}}}
world:
  valve: {{mechanism: hinge, xyz: [490 mm, 0, 350 mm], inertia: 0.01 kg*m^2,
    damping: 0.2 N*m*s/rad, friction: 0.5 N*m}}
frames: {{believed: {{parent: valve, rpy: [{askew}, 0, 0]}}}}
frame: believed
law: {law}
stages:
  close:
    axes: {{x: {{force: 0}}, y: {{force: 0}}, z: {{force: 0}}, rx: {{torque: 0}}, ry: {{torque: 0}},
      rz: {{velocity: -30 deg/s}}}}
    until: position.rz < -60 deg
    within: 5 s
expect:
  - rms(close.torque.ry) < {most}
"""


@pytest.mark.parametrize("askew", ["2 deg", "4 deg"])
@pytest.mark.parametrize("law", ["pd", "impedance-natural"])
def test_a_spring_bears_what_a_mechanism_takes_it_off_its_rest(law, askew, tmp_path):
    """Within 12 %: 6 to 10 % more than measured.

    The axis is taken to miss sin(askew) of the whole turn, and misses that of its chord: 2 sin(30
    deg), 5 % less. Friction lets the rest lag.
    """
    plan = examine(load_text(VALVE.format(law=law, askew=askew, most="9 N*m"), "t.yaml")).plan
    course = ForceCourses(plan).of("close", Axis.RY)
    assert course is not None
    run = forced(VALVE.format(law=law, askew=askew, most="9 N*m"), tmp_path / "run")
    measured = run.history.columns["torque.ry"]
    borne = float(np.sqrt(np.mean(course.applied**2)))
    assert borne == pytest.approx(float(np.sqrt(np.mean(measured**2))), rel=0.12)


@pytest.mark.parametrize(("law", "codes"), [("pd", ["TS726"]), ("hybrid", [])])
def test_a_moment_of_0_is_no_moment_only_under_a_force_loop(law, codes):
    found = examine(load_text(VALVE.format(law=law, askew="4 deg", most="1.5 N*m"), "t")).findings
    assert [each.code for each in found if each.code == "TS726"] == codes


SPRING = """
taskspec: 1
name: spring
robot: {{model: ur5e, start: {{xyz: [450 mm, 0, 304 mm]}}}}
world:
  table: {{shape: plane, xyz: [450 mm, 0, 300 mm], stiffness: 20 kN/m, damping: 30 N*s/m}}
frame: {frame}
frames: {{top: {{surface: table}}, plain: {{xyz: [0, 0, 300 mm]}}}}
law: {law}
stages:
  approach:
    axes: {{z: {{velocity: -15 mm/s * smooth(t/(0.2 s))}}}}
    until: force.z < -2 N
    within: 3 s
  press: {{axes: {{{axes}}}, {ends}}}
"""


@pytest.mark.parametrize("frame", ["plain", "top"])
@pytest.mark.parametrize(
    ("law", "axes"),
    [
        ("impedance-natural", "z: {force: -12 N}"),
        ("impedance", "z: {force: -12 N}, x: {move: 10 mm}"),
        ("pd", "z: {position: -15 mm}"),
        ("impedance-natural", "z: {position: -15 mm}, x: {velocity: 20 mm/s}"),
    ],
)
def test_the_force_of_a_spring_goes_as_predicted(frame, law, axes, simulate):
    """12 % of the last force, from 0.25 s on.

    By how much a damper lets the reference lead as the tool touches, 1.8 of 16 mm under `pd`, is
    left out, and so is its blending, which is over by then.
    """
    text = SPRING.format(frame=frame, law=law, axes=axes, ends="time: 1 s")
    examined = examine(load_text(text, "t.yaml"))
    assert all(d.code == "TS130" for d in examined.findings)
    course = ForceCourses(examined.plan).of("press", Axis.Z)
    run = simulate(text).during("press", "force.z")
    late = course.times > 0.25
    assert course.applied[late] == pytest.approx(run[late], abs=0.12 * abs(run[-1]))


@pytest.mark.parametrize(
    ("guard", "code"),
    [
        ("time: 1 s, fail_if: force.z < -14 N", None),
        ("time: 1 s, fail_if: force.z < -10 N for 50 ms", "TS618"),
        ("until: force.z < -10 N, within: 1 s", None),
        ("until: abs(force.z) > 16 N, within: 1 s", "TS611"),
    ],
)
def test_guards_are_held_against_what_a_spring_comes_to(guard, code, simulate):
    text = SPRING.format(frame="top", law="impedance-natural", axes="z: {force: -12 N}", ends=guard)
    found = [d.code for d in examine(load_text(text, "t.yaml")).findings if d.code != "TS130"]
    assert found == ([code] if code else [])
    assert (simulate(text).outcome.status == "done") == (code is None)


def test_what_is_fed_forward_along_one_axis_does_not_disturb_another():
    """x swings with 0.3 m/s^2, which would be 1 N along z: the run keeps it to 4 mN."""
    task = Path(__file__).resolve().parents[2] / "tasks" / "press-impedance-natural.yaml"
    examined = examine(load_task(task))
    course = ForceCourses(examined.plan).of("slide", Axis.Z)
    assert course is not None
    np.testing.assert_allclose(course.applied, -20.0, atol=0.01)
    assert "TS726" not in {each.code for each in examined.findings}


EDGE = """
taskspec: 1
robot:
  model: panda
  tool: {{shape: sphere, radius: 6 mm}}
  start: {{xyz: [450 mm, 60 mm, 300 mm]}}
world: {{plate: {{shape: box, size: [200 mm, 80 mm, 20 mm], xyz: [500 mm, 0, 300 mm]}}}}
frame: world
stages:
  approach:
    axes: {{y: {{velocity: -20 mm/s}}}}
    until: force.y < -1.5 N for 5 ms
    within: {{time: 3 s, travel: 30 mm}}
  follow:
    axes: {{y: {{force: -6 N}}, x: {{velocity: 30 mm/s}}}}
    until: force.y > -1 N for 5 ms
    within: {{time: 8 s, travel: {travel}}}
"""


@pytest.mark.parametrize(("travel", "told"), [("200 mm", False), ("120 mm", True)])
def test_a_force_ends_where_the_way_leads_off_what_is_pressed_on(travel, told):
    """The plate ends 150 mm further on."""
    found = examine(load_text(EDGE.format(travel=travel), "t.yaml")).findings
    assert any(d.code == "TS611" and "never holds" in d.message for d in found) is told
