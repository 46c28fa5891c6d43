"""Rules about stages and their order."""

from __future__ import annotations

import pytest

from taskspec.spec import load_text
from taskspec.text.diagnostic import SpecError

HEAD = "taskspec: 1\nrobot: {model: panda}\nworld: {table: {shape: plane}}\nstages:\n"


def codes(stages: str) -> list[str]:
    text = HEAD + "".join(f"  {line}\n" for line in stages.strip().split("\n"))
    try:
        return [d.code for d in load_text(text, "t.yaml").warnings]
    except SpecError as error:
        return [d.code for d in error.diagnostics]


@pytest.mark.parametrize(
    "stages",
    [
        "a: {time: 1 s}",
        "a: {axes: {z: {move: 3 mm}}}",
        "a: {path: {to: [1 mm], time: 1 s}}",
        "a: {until: touching, within: {time: 1 s}}",
        "a: {until: touching, within: 1 s}",
        "a: {until: path_done, within: {time: 1 s}, path: {to: [1 mm], time: 1 s}}",
        "a: {time: 1 s, within: {travel: 3 mm}}",
        "a: {time: 1 s, next: end, on_fail: fail}",
        "a: {time: 1 s, on_fail: c}\nb: {time: 1 s, next: end}\nc: {time: 1 s}",
        "a: {time: 1 s, attempts: 2}\nb: {time: 1 s, on_fail: a}",
        "a: {time: 1 s, next: a, attempts: 2}",
        "a: {time: 1 s}\nb: {time: 1 s, attempts: 3, on_fail: c, next: end}\n"
        "c: {time: 1 s, next: a}",
    ],
)
def test_well_ordered(stages: str) -> None:
    assert codes(stages) == []


@pytest.mark.parametrize(
    ("stages", "found"),
    [
        ("a: {}", ["TS602"]),
        ("a: {axes: {z: {force: -3 N}}}", ["TS602"]),
        ("a: {fail_if: touching}", ["TS602"]),
        ("a: {within: {time: 1 s}}", ["TS602"]),
        ("a: {until: touching}", ["TS601"]),
        ("a: {until: touching, within: {time: 1 s}, time: 2 s}", ["TS603"]),
        ("a: {time: 1 s, next: a}", ["TS604"]),
        ("a: {time: 1 s}\nb: {time: 1 s, next: a}", ["TS604"]),
        ("a: {time: 1 s, on_fail: a, next: a}", ["TS604", "TS604"]),
        ("a: {time: 1 s, next: end}\nb: {time: 1 s}", ["TS605"]),
        ("a: {time: 1 s, next: c}\nb: {time: 1 s}\nc: {time: 1 s}", ["TS605"]),
        # What is unknown here may have been a way to anywhere.
        ("a: {time: 1 s, next: cc}\nb: {time: 1 s, next: end}\nc: {time: 1 s}", ["TS124"]),
        # A condition that does not read may have bounded the circle.
        ("a: {time: 1 s, next: [{when: a.visits <, to: a}, {to: end}]}", ["TS101"]),
        ("a: {time: 1 s, next: [{when: a.visist < 3, to: a}, {to: end}]}", ["TS116"]),
        ("a: {time: 1 s, next: [{when: a.visits, to: a}, {to: end}]}", ["TS114"]),
        ("a: {time: 1 s, next: [{when: many < 3, to: a}, {to: end}]}", ["TS120"]),
        ("a: {time: 1 s, next: [{when: , to: a}, {to: end}]}", ["TS011"]),
        # What is wrong already is not called absent as well.
        ("a: {tim: 1 s}", ["TS020"]),
        ("a: {time: }", ["TS011"]),
        ("a: {until: touching, withn: {time: 1 s}}", ["TS020"]),
        ("a: {axes: {z: {mov: 3 mm}}}", ["TS020"]),
        ("a: {path: {spiral: {pitch: 1 mm}, speed: 1 mm/s}}", ["TS021"]),
        ("a: {path: {raster: {size: [1 mm], pitch: 1 mm}, time: 1 s}}", ["TS023"]),
        ("a: {path: {waypoints: {points: [[0], [1 mm, 0]]}, time: 1 s}}", ["TS023"]),
        ("a: {path: {waypoints: {points: [1 mm, 0]}, time: 1 s}}", ["TS022"]),
        ("a: {path: {waypoints: {points: [[1 mm, 0]]}, time: 1 s}}", ["TS023"]),
    ],
)
def test_badly_ordered(stages: str, found: list[str]) -> None:
    assert codes(stages) == found


@pytest.mark.parametrize("law", ["hybrid", "impedance", "impedance-natural", "pd"])
def test_motion_and_force_need_a_parallel_law(law: str) -> None:
    axis = "axes: {z: {position: 0, force: -3 N}}"
    assert codes(f"a: {{time: 1 s, law: {law}, {axis}}}") == ["TS203"]
    assert codes(f"a: {{time: 1 s, law: parallel, {axis}}}") == []
