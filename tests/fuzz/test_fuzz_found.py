"""Files that fuzzing found to break a promise, as small as they got, and what they are told now."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from promises import found_in, held

ROOT = Path(__file__).parents[2]
HEAD = "taskspec: 1\nrobot: {model: panda}\n"
WAIT = "stages: {a: {time: 1 s}}\n"

FOUND = {
    "a stage whose name is half a pattern": (
        HEAD + 'stages: {"a(b": {time: 1 s}}\nexpect: [peak force < 3 N]\n',
        {"TS125", "TS101"},
    ),
    "a path that lasts longer than moves can be planned": (
        HEAD + "stages: {a: {path: {to: [0, 1e15 mm, 0, 0 deg], speed: 5 mm/s}}}\n",
        {"TS118"},
    ),
    "a gain that is hardly a number": (
        "taskspec: 1\nrobot: {model: ur5e, balanced: true}\n"
        "world: {table: {shape: plane, stiffness: 1 N/m, damping: 0}}\nframe: table\n"
        "law: {kind: stiffness, stiffness: {linear: 5e-324 kN/m, angular: 0}}\n" + WAIT,
        set(),
    ),
    "a stiffness that may become negative": (
        "taskspec: 1\nrobot: {model: panda, start: {xyz: [500 mm, 0, 300 mm]}}\n"
        "world: {table: {shape: plane, xyz: [0, 0, 300 mm]}}\nframe: table\n"
        "stages: {a: {axes: {z: {force: -5 N}}, time: 1 s}}\n"
        "vary: {world.table.stiffness: +- 30 kN/m}\n",
        {"TS118"},
    ),
    "noise that varies where there is no sensor": (
        HEAD + WAIT + "vary: {robot.sensor.noise.force: +- 1 N}\n",
        {"TS118"},
    ),
    "a law that is a mapping": (
        HEAD + "law: {kind: {z: 1}}\n" + WAIT,
        {"TS022"},
    ),
    "a plane at the end of the range of floats": (
        HEAD + "world: {table: {shape: plane, xyz: [0, 0, -1e300 mm]}}\n" + WAIT,
        {"TS015"},
    ),
    "a large number inside of an expression of time": (
        HEAD + "stages: {a: {axes: {x: {position: 1e300 m * sin(t/(1 s))}}, time: 1 s}}\n",
        {"TS015"},
    ),
    "a product that is too large": (
        HEAD + "params: {far: 1e9 m * 1e9}\n" + WAIT,
        {"TS118"},
    ),
    "a tool without an extent": (
        "taskspec: 1\nrobot: {model: panda, tool: {radius: 1e-300 mm}}\n" + WAIT,
        {"TS118"},
    ),
    "a path that takes no time": (
        HEAD + "stages: {a: {path: {line: {by: [60 mm]}, time: 1e-9 s}}}\n",
        {"TS420"},
    ),
    "a path to where the tool is, up to rounding": (
        "taskspec: 1\nrobot: {model: panda, tool: {radius: 1 m, length: 0}, "
        "start: {xyz: [450 mm, 0, 300 mm]}}\n"
        "stages: {a: {path: {to: [450 mm, 0, 300 mm], speed: 100 mm/s}}}\n",
        set(),
    ),
    "a direction of no length, up to rounding": (
        HEAD
        + "world: {wall: {shape: plane}}\n"
        + "frames: {f: {surface: wall, heading: [0, 5e-324, 0]}}\n"
        + WAIT,
        {"TS118"},
    ),
    "many paths out of reach": (
        HEAD
        + "stages:\n"
        + "".join(
            f"  s{i}: {{path: {{line: {{by: [6 m]}}, time: {i + 1} s}}}}\n" for i in range(30)
        ),
        {"TS420", "TS421"},
    ),
}


@pytest.mark.parametrize(("text", "codes"), FOUND.values(), ids=FOUND)
def test_found(text: str, codes: set[str]) -> None:
    held(text, ROOT / "tasks")
    assert {d.code for d in found_in(text, ROOT / "tasks")[0]} == codes


def test_the_ends_of_the_range_are_in_it() -> None:
    text = HEAD + "params: {a: 1e12 m, b: -1e12}\n"
    text += "limits: {force: 1e-12 N}\n" + WAIT
    assert found_in(text, ROOT / "tasks")[2]
