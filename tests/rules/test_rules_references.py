"""References that are not finite somewhere in their stage, and positions that jump."""

from __future__ import annotations

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text
from taskspec.text.diagnostic import Diagnostic

TASK = """
taskspec: 1
robot: {model: panda, start: {xyz: [500 mm, 0, 340 mm]}}
params: {when: 1.5 s}
stages:
  go: {axes: {AXES}, END}
  then: {time: 1 s}
"""


def found(axes: str, end: str = "time: 2 s", task: str = TASK) -> list[Diagnostic]:
    loaded = load_text(task.replace("AXES", axes).replace("END", end), "t")
    return [d for d in check_task(loaded) if d.code in ("TS117", "TS423")]


WAY = "500 mm + 10 mm"


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (f"x: {{position: {WAY} / (1 - t/when)}}", "this has no finite value at t = 1.5 s"),
        (f"x: {{position: {WAY} * sqrt(1 - t/when)}}", "the rate of this has no finite value"),
        # t^1.5 has a rate at 0, and no acceleration.
        (f"x: {{position: {WAY} * sqrt((t/when - 1)^3)}}", "this has no finite value at t = 0"),
        (f"x: {{position: {WAY} * (1 - t/when)^2 / abs(1 - t/when)}}", "at t = 1.5 s"),
        ("x: {velocity: 10 mm/s * log(1 - t/when)}", "at t = 1.5 s"),
        ("x: {velocity: 10 mm/s * log(1 - clock/when)}", "at t = 1.5 s"),
    ],
)
def test_what_has_no_value_later(axes: str, message: str) -> None:
    (finding,) = found(axes)
    assert finding.code == "TS117"
    assert str(finding.severity) == "error"
    assert message in finding.message
    assert found(axes, "time: 1.4 s") == [] or "t = 0" in message


def test_a_guard_may_end_the_stage_before() -> None:
    (finding,) = found(
        "x: {velocity: 10 mm/s * log(1 - t/when)}", "until: travel > 1 mm, within: {time: 2 s}"
    )
    assert str(finding.severity) == "warning"


def test_what_depends_on_signals_is_left_alone() -> None:
    assert found("x: {velocity: 10 mm/s * sqrt(1 - travel/(1 mm) - t/when)}") == []


@pytest.mark.parametrize(
    ("position", "jumps"),
    [
        (f"{WAY} * sign(t - when)", True),
        (f"{WAY} * sign(t - when - 0.3 ms)", True),
        (f"{WAY}/(1 rad) * atan2(sin(2*pi*t/when), cos(2*pi*t/when))", True),
        # Less than 2 mm is no knock.
        ("500 mm + 0.9 mm * sign(t - when)", False),
        (f"{WAY} * smooth((t - when)/(100 ms))", False),
        (f"{WAY} * abs(sin(2*pi*t/when))", False),
        (f"{WAY} * clamp(t/when, 0, 1)", False),
        # 1.3 m/s, and resolved by its ticks.
        (f"{WAY} * sin(2*pi*t*20 Hz)", False),
        ("500 mm", False),
    ],
)
def test_positions_that_jump(position: str, jumps: bool) -> None:
    assert [d.code for d in found(f'x: {{position: "{position}"}}')] == ["TS423"] * jumps


def test_rotations_jump_by_degrees() -> None:
    (finding,) = found("rz: {position: 2 deg * sign(t - when)}")
    assert "2 deg" in finding.message
    assert found("rz: {position: 0.4 deg * sign(t - when)}") == []


def test_objects_that_move_out_of_existence() -> None:
    world = "world: {table: {shape: plane, motion: {z: 2 mm * sqrt(1 - clock/(4 s))}}}\nstages"
    task = TASK.replace("stages", world)
    assert found("x: hold", "time: 2 s", task) == []
    (finding,) = found("x: hold", "time: 5 s", task)
    assert (finding.code, str(finding.severity)) == ("TS117", "warning")
