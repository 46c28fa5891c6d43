"""Tasks that are right and unlike the shipped ones: laws, arms, sensors, equations, mechanisms."""

from __future__ import annotations

import pytest

from taskspec.examination import check_task
from taskspec.laws import LAWS
from taskspec.spec import load_text
from taskspec.text.diagnostic import Severity

PRESS = """
taskspec: 1
robot: {ROBOT}
world: {table: {shape: plane, xyz: [0, 0, 300 mm], TABLE}MORE}
frames: {task: {surface: table}}
frame: task
law: LAW
limits: {force: 100 N}
stages:
  approach: {axes: {z: {velocity: -20 mm/s}}, until: UNTIL, within: {time: 4 s}}
  STAGES
expect: [EXPECT]
"""
RAIL = """
taskspec: 1
robot: {model: MODEL, start: {xyz: START}}
world: {rail: {equation: "EQUATION"}}
law: LAW
stages: {go: {constraints: {rail: {force: WANTED}}, axes: {AXES}, time: 2 s}}
expect: [last(go.rail.force) within WANTED +- 1 N]
"""
HELD = """
taskspec: 1
robot: {model: panda, grasp: thing.handle}
world: {thing: {mechanism: KIND, xyz: [480 mm, 0, 350 mm]MORE}}
frame: thing.handle
law: LAW
stages: {go: {axes: {AXES}, until: UNTIL, within: {time: 8 s}}}
"""
PANDA = "model: panda, start: {xyz: [500 mm, 0, 320 mm]}"
UR5E = "model: ur5e, start: {xyz: [450 mm, 100 mm, 320 mm]}"
USUAL = {
    "ROBOT": PANDA, "TABLE": "friction: 0.2", "MORE": "", "LAW": "hybrid",
    "UNTIL": "force.z < -2 N", "STAGES": "press: {axes: {z: {force: -10 N}}, time: 2 s}",
    "EXPECT": "last(press.force.z) within -10 +- 0.5 N",
}  # fmt: skip


def errors(text: str, changes: dict[str, str]) -> list[str]:
    for word, written in changes.items():
        text = text.replace(word, written)
    found = check_task(load_text(text, "t"))
    return [f"{d.code}: {d.message}" for d in found if d.severity is Severity.ERROR]


def moving(stage: str, expect: str = "max(norm(force)) < 90 N") -> dict[str, str]:
    return {"STAGES": stage, "EXPECT": expect}


def under(law: str, robot: str = PANDA) -> dict[str, str]:
    """A law on an arm that takes what it commands."""
    return {"LAW": law, "ROBOT": f"{robot}, command: {LAWS[law].commands}"}


MULTIPLIERS = [law for law in LAWS if LAWS[law].multipliers]


@pytest.mark.parametrize(
    "changes",
    [
        *(under(law) for law in LAWS if law != "stiffness"),
        # Under it the arm has to be balanced by its hardware.
        {"LAW": "stiffness", "ROBOT": f"{PANDA}, balanced: true"},
        *(under(law, UR5E) for law in LAWS if LAWS[law].force_loop),
        *(
            {**under(law), "LAW": f"{{kind: {law}, solve: qp}}"}
            for law in LAWS
            if LAWS[law].force_loop
        ),
        {"TABLE": "stiffness: rigid"},
        {"TABLE": "stiffness: 1 kN/m"},
        {"TABLE": "motion: {z: 2 mm * sin(2*pi*clock*1 Hz)}"},
        {"MORE": ", block: {shape: box, size: [200 mm, 200 mm, 40 mm], xyz: [500 mm, 300 mm, 0]}"},
        {"ROBOT": f"{PANDA}, sensor: {{delay: 3 ms, rate: 500 Hz}}"},
        {"ROBOT": f"{PANDA}, tool: {{shape: box, size: [30 mm, 20 mm, 10 mm], mass: 200 g}}"},
        {"UNTIL": "(force.z < -2 N for 20 ms) and t > 100 ms"},
        {"UNTIL": "force.z < -2 N or gap < 0.05 mm"},
        {"ROBOT": f"{PANDA}, sensor: {{at: wrist, bias: [0, 0, 2 N, 0, 0, 0], noise: 50 mN}}",
         "UNTIL": "gap < 10 mm",
         **moving("zero: {tare: true, time: 1 s}\n  down: {axes: {z: {velocity: -20 mm/s}}, "
                  "until: force.z < -2 N for 5 ms, within: {time: 4 s}}")},
        moving("go: {axes: {x: {position: 40 mm*sin(2*pi*t/(3 s))}, "
               "z: {force: -9 N - 2 N*t/(9 s)}}, "
               "time: 6 s}", "rms(go.error.x) < 1 mm"),
        moving("go: {axes: {z: {force: -9 N}}, path: {lissajous: {amplitude: [30 mm, 20 mm], "
               "turns: [1, 2]}, time: 6 s}}", "go.force.z < -5 N for 90 %"),
        moving("go: {axes: {z: {force: -9 N}}, path: {arc: {center: [30 mm, 0], turns: -1}, "
               "speed: 40 mm/s}}", "max(go.speed) < 60 mm/s"),
        moving("go: {axes: {x: {move: 30 mm, speed: 20 mm/s, stiffness: 500 N/m}, "
               "z: {force: -9 N}}}"),
        moving("go: {axes: {z: {force: -9 N}}, time: 1 s, attempts: 3, next: lift}\n"
               "  lift: {axes: {z: {move: 20 mm}}, next: again}\n"
               "  again: {axes: {z: {velocity: -20 mm/s}}, until: touching, within: {time: 4 s}, "
               "next: go, on_fail: end}", "go.visits <= 3"),
        {"LAW": "{kind: hybrid, null_space: manipulability}"},
        {"EXPECT": "press.visits within 1..1, max(press.table.force) within 0..20 N"},
    ],
    ids=str,
)  # fmt: skip
def test_presses(changes: dict[str, str]) -> None:
    assert errors(PRESS, {**USUAL, **changes}) == []


@pytest.mark.parametrize("law", MULTIPLIERS)
@pytest.mark.parametrize(
    ("model", "start", "equation", "wanted", "axes"),
    [
        ("planar2", "[300 mm, 0, 0]", "x^2 + y^2 = (300 mm)^2", "20 N", ""),
        ("planar3", "[500 mm, 0, 0]", "x = 500 mm", "-5 N", "y: {velocity: 10 mm/s}"),
        ("panda", "[500 mm, 0, 350 mm]", "z >= 350 mm", "-8 N", "x: {velocity: 10 mm/s}"),
        ("ur5e", "[450 mm, 100 mm, 300 mm]", "x + z = 750 mm", "5 N", "y: {velocity: 10 mm/s}"),
    ],
)
def test_equations(law: str, model: str, start: str, equation: str, wanted: str, axes: str) -> None:
    model = f"{model}, command: {LAWS[law].commands}"
    changes = {"MODEL": model, "START": start, "EQUATION": equation, "WANTED": wanted}
    assert errors(RAIL, {**changes, "AXES": axes, "LAW": law}) == []


@pytest.mark.parametrize("law", ["hybrid", "parallel"])
@pytest.mark.parametrize(
    ("kind", "more", "axes", "until"),
    [
        ("hinge", ", handle: [100 mm, 0, 0], knob: free, friction: 0.1 N*m, "
                  "detent: {at: 20 deg, force: 0.2 N*m, width: 5 deg}",
         "x: {force: 0}, y: {velocity: 60 mm/s}, z: {force: 0}", "thing.angle > 90 deg"),
        ("slide", ", rpy: [0, 90 deg, 0], mass: 2 kg, stop: 0..300 mm",
         "x: {force: 0}, y: {force: 0}, z: {velocity: 30 mm/s}", "thing.travel > 50 mm"),
        ("screw", ", pitch: 2 mm/turn",
         "x: {force: 0}, y: {force: 0}, z: {follows: thing}, rz: {velocity: 30 deg/s}",
         "thing.angle > 60 deg"),
    ],
)  # fmt: skip
def test_mechanisms(law: str, kind: str, more: str, axes: str, until: str) -> None:
    changes = {"KIND": kind, "MORE": more, "AXES": axes, "UNTIL": until, "LAW": law}
    assert errors(HELD, changes) == []
