"""Mechanisms, joints and edges: what a trial finds on the way of a stage."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from trials import checked, found, serious

import taskspec_runner
from taskspec.compiler import admit
from taskspec.examination import examine
from taskspec.program.prepare import prepare
from taskspec.spec import load_text
from taskspec_runner.trial.trial import trial

SCREW = """
taskspec: 1
robot: {{model: panda, grasp: cap.handle{start}}}
world:
  cap: {{mechanism: screw, xyz: [500 mm, 0, 300 mm], rpy: [180 deg, 0, 0], pitch: {pitch},
    inertia: 0.001 kg*m^2, mass: 200 g, damping: 0.05 N*m*s/rad, friction: 0.1 N*m}}
frame: cap
limits: {{force: 60 N, torque: 6 N*m, speed: 250 mm/s}}
stages:
  screw_down:
    axes: {{x: {{force: 0}}, y: {{force: 0}}, z: {z}, rx: {{torque: 0}}, ry: {{torque: 0}},
      rz: {{velocity: 60 deg/s}}}}
    until: cap.angle > {until}
    within: {{time: 8 s}}
"""
TURNED = ", start: {rpy: [180 deg, 0, 120 deg]}"
CRANK = """
taskspec: 1
robot: {{model: panda, grasp: crank.handle}}
world:
  crank: {{mechanism: hinge, xyz: [500 mm, 0, 350 mm], handle: [120 mm, 0, 0], knob: {knob},
    inertia: 0.05 kg*m^2, damping: 0.2 N*m*s/rad}}
frame: crank.handle
limits: {{force: 40 N, torque: 5 N*m}}
stages:
  rotate:
    axes: {{x: {x}, y: {{velocity: 100 mm/s}}, z: {{force: 0}}, rx: {{torque: 0}},
      ry: {{torque: 0}}, rz: {rz}}}
    until: crank.angle > {until}
    within: {{time: 20 s}}
"""
DRAWER = """
taskspec: 1
robot: {{model: panda, grasp: drawer.handle}}
world:
  drawer: {{mechanism: slide, xyz: [600 mm, 0, 400 mm], rpy: [0, -90 deg, 0], mass: 2 kg,
    damping: 20 N*s/m, friction: 2 N, stop: 0..200 mm}}
frame: drawer.handle
limits: {{force: 40 N, torque: 8 N*m, speed: 300 mm/s}}
stages:
  pull:
    axes: {{x: {{force: 0}}, y: {{force: 0}}, z: {z}, rx: {{torque: 0}}, ry: {{torque: 0}},
      rz: {{torque: 0}}}}
    {end}
"""
GATE = """
taskspec: 1
robot: {{model: ur5e, grasp: gate.handle}}
world:
  gate: {{mechanism: slide, xyz: [480 mm, 0, 350 mm], mass: 5.5 kg, damping: 12 N*s/m,
    friction: {friction}}}
frame: gate
law: {law}
limits: {{force: {force}}}
stages:
  go:
    axes: {{x: {{force: 0}}, y: {{force: 0}}, z: {{velocity: {speed}}}, rx: {{torque: 0}},
      ry: {{torque: 0}}, rz: {{torque: 0}}}}
    until: gate.travel > {until}
    within: {{time: {time}}}
"""
FREE = """
taskspec: 1
robot: {{model: panda, start: {{xyz: [400 mm, 0, 400 mm]}}}}
limits: {{speed: 2 m/s}}
stages: {{go: {{axes: {{{axes}}}{end}}}}}
"""
DRUM = """
taskspec: 1
robot: {{model: panda, start: {{xyz: [500 mm, 0, 370 mm]}}}}
world:
  drum: {{shape: cylinder, radius: 150 mm, length: 600 mm, xyz: [500 mm, 0, 200 mm],
    rpy: [90 deg, 0, 0], stiffness: 20 kN/m}}
frames: {{top: {{surface: drum, heading: [0, 1, 0]}}}}
frame: top
limits: {{force: 60 N, speed: 300 mm/s}}
stages:
  touch: {{axes: {{z: {{velocity: -30 mm/s}}}}, until: force.z < -3 N, within: {{time: 4 s}}}}
  go: {{axes: {{z: {{force: -10 N}}, x: {x}}}, time: {time}}}
"""


def screw(
    *, until: str, pitch: str = "4 mm/turn", z: str = "{follows: cap}", start: str = TURNED
) -> str:
    return SCREW.format(start=start, until=until, pitch=pitch, z=z)


def crank(
    *, until: str, knob: str = "free", x: str = "{force: 0}", rz: str = "{hold: world}"
) -> str:
    return CRANK.format(until=until, knob=knob, x=x, rz=rz)


def drawer(z: str, end: str) -> str:
    return DRAWER.format(z=z, end=end)


def gate(
    *, law: str, speed: str, until: str, time: str, friction: str = "32 N", force: str = "60 N"
) -> str:
    return GATE.format(law=law, speed=speed, until=until, time=time, friction=friction, force=force)


#: How far a stage takes a slide, by the law: whose reference comes there in time.
BEHIND = {
    name: gate(law=law, speed=speed, until=until, time=time)
    for name, law, speed, until, time in (
        ("a spring", "impedance", "79 mm/s", "30 mm", "1.6 s"),
        ("a bandwidth", "{kind: hybrid, bandwidth: 0.5 Hz}", "25 mm/s", "40 mm", "3 s"),
        ("a drag", "{kind: pd, stiffness: {linear: 600 N/m}}", "60 mm/s", "80 mm", "1.7 s"),
        ("joints", "{kind: pd-joint, stiffness: {linear: 600 N/m}}", "25 mm/s", "50 mm", "2.5 s"),
    )
}


ANNOUNCED = {
    # name: file, code, and what stops the run.
    "wrist": (screw(until="300 deg"), "TS424", "position limit of joint"),
    "wrist of a crank": (
        crank(until="1 turn", knob="fixed", rz="{torque: 0}"),
        "TS424",
        "position limit of joint",
    ),
    "turns": (FREE.format(axes="rz: {move: 3 turn}", end=""), "TS424", "position limit of joint"),
    "thread": (
        screw(until="180 deg", pitch="10 mm/turn", z="{hold: start}"),
        "TS616",
        "limit on force",
    ),
    "advance": (screw(until="180 deg", z="{velocity: 5 mm/s}"), "TS616", "limit on force"),
    "radial": (crank(until="1 turn", x="{velocity: 10 mm/s}"), "TS616", "limit on force"),
    "stop": (drawer("{velocity: 80 mm/s}", "time: 4 s"), "TS616", "limit on force"),
    "move": (drawer("{move: 250 mm, speed: 100 mm/s}", ""), "TS616", "limit on force"),
    "heavy": (
        gate(law="pd-joint", speed="110 mm/s", until="70 mm", time="4 s", force="45 N"),
        "TS616",
        "limit on force",
    ),
    "swift": (
        FREE.format(axes="y: {move: 300 mm, speed: 1.5 m/s}", end=""),
        "TS424",
        "velocity limit of joint",
    ),
    "edge": (DRUM.format(x="{velocity: 150 mm/s}", time="3 s"), "TS425", "left the part"),
}
FINE = {
    "wrist": screw(until="200 deg"),
    "thread": screw(until="90 deg", pitch="0.1 mm/turn", z="{hold: start}"),
    "crank": crank(until="1 turn"),
    "crank with a fixed knob": crank(until="60 deg", knob="fixed", rz="{torque: 0}"),
    "stop": drawer("{velocity: 80 mm/s}", "time: 2 s"),
    "move": drawer("{move: 180 mm, speed: 100 mm/s}", ""),
    "felt stop": drawer("{velocity: 60 mm/s}", "until: drawer.force > 15 N\n    within: 6 s"),
    "swift": FREE.format(axes="y: {move: 200 mm, speed: 300 mm/s}", end=""),
    "turns": FREE.format(axes="rz: {move: 45 deg}", end=""),
    "drum": DRUM.format(x="{velocity: 100 mm/s}", time="1 s"),
    "sine on a drum": DRUM.format(x="{position: 50 mm*sin(2 rad/s*t)}", time="3 s"),
}


@pytest.mark.parametrize("name", ANNOUNCED)
def test_what_stops_the_run_is_reported_at_its_time(name: str) -> None:
    text, code, limit = ANNOUNCED[name]
    finding = found(text, code)
    assert limit in finding.message
    once = trial(admit(checked(text)))
    assert once.outcome.status == "stopped"
    clock = re.search(r"run time ([\d.]+) s", finding.message)
    assert clock is not None, finding.message
    assert float(clock[1]) == pytest.approx(once.transitions[-1].clock, rel=1e-3)


@pytest.mark.parametrize("name", BEHIND)
def test_a_mechanism_is_taken_along_as_far_as_its_law_bears(name: str, tmp_path: Path) -> None:
    """Friction, damping and inertia hold it back from a reference that comes there in time."""
    task = load_text(BEHIND[name], "task.yaml")
    examined = checked(BEHIND[name])
    assert examined.plan is not None
    passage = examined.plan.stages["go"].nominal.passage
    assert {d.code for d in examined.findings} == {"TS611"}
    assert passage is not None
    assert passage.drive is not None
    run = taskspec_runner.run(task, tmp_path / "run", force=True)
    assert run.summary["status"] == "failed"
    predicted = passage.drive.at(run.clock[-1])[0]
    # The start pose's gains and inertia for the whole way: 4 %, and the play of the grip.
    assert run.columns["gate.travel"][-1] == pytest.approx(predicted, rel=0.04, abs=0.5e-3)


def codes(text: str) -> set[str]:
    return set(serious(text))


def test_a_stiffer_law_takes_the_mechanism_there_in_time() -> None:
    text = gate(
        law="{kind: pd, stiffness: {linear: 6 kN/m}}", speed="60 mm/s", until="80 mm", time="1.7 s"
    )
    assert codes(text) == set()


def test_a_start_that_is_left_open_has_room_for_the_stages(tmp_path: Path) -> None:
    """Nearest home the wrist has 121 deg left; a turned start has 200 deg, and the task passes."""
    text = screw(until="200 deg", start="")
    assert codes(text) == set()
    given = text.replace("grasp: cap.handle", "grasp: cap.handle, start: {rpy: [180 deg, 0, 0]}")
    assert "TS424" in codes(given)
    run = taskspec_runner.run(load_text(text, "task.yaml"), tmp_path / "run")
    assert run.summary["status"] == "done"


def test_a_start_with_room_is_the_one_nearest_home() -> None:
    loaded = load_text(crank(until="1 turn"), "task.yaml")
    plan = examine(loaded, stability=False).plan
    assert plan is not None
    assert plan.context.start.tolist() == prepare(loaded).start.tolist()


@pytest.mark.parametrize("name", FINE)
def test_a_like_file_that_ends_well_is_silent(name: str) -> None:
    assert codes(FINE[name]) == set()
