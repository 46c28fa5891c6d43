"""Planned motions into surfaces and off equations."""

from __future__ import annotations

import re

import pytest

from taskspec.examination import check_task
from taskspec.spec import load_text

TASK = """
taskspec: 1
name: leaves
robot: {model: panda, start: {xyz: [540 mm, 0, 350 mm]}}
frames: {rail: {xyz: [450 mm, 0, 350 mm]}, over: {parent: table}}
world:
  table: {shape: plane, xyz: [0, 0, 320 mm]}
  WORLD
frame: FRAME
law: LAW
stages: {go: {STAGE}, stay: {time: 2 s}}
"""
GOOD = {"WORLD": "", "FRAME": "over", "LAW": "hybrid"}
RIM = 'rim: {equation: "x^2 + y^2 = (90 mm)^2", frame: rail}'


TOUCH = "axes: {z: {velocity: -40 mm/s}}, until: touching, within: 3 s},"


def text(**changes):
    filled = TASK
    for key, value in (GOOD | changes).items():
        filled = filled.replace(key, value)
    return filled


def findings(task):
    """All but that a stage does not use both frames."""
    return [d for d in check_task(load_text(task, "t")) if d.code != "TS130"]


def codes(**changes):
    return [d.code for d in findings(text(**changes))]


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"STAGE": "axes: {z: {move: -29 mm}}"}, []),
        ({"STAGE": "axes: {z: {move: -35 mm}}"}, ["TS321"]),
        ({"STAGE": "axes: {z: {move: -35 mm}}", "LAW": "impedance"}, []),
        ({"STAGE": "axes: {z: {move: -35 mm, stiffness: 200 N/m}}"}, []),
        ({"STAGE": "axes: {z: {position: 25 mm - 10 mm * t/(1 s)}}, time: 3 s"}, ["TS321"]),
        ({"STAGE": "path: {line: {by: [20 mm, 0, -35 mm]}, time: 2 s}"}, ["TS321"]),
        (
            {
                "STAGE": "axes: {z: {velocity: -20 mm/s}}, until: touching, within: {time: 3 s}",
            },
            [],
        ),
        # 40 mm/s are braked within 2 mm, which is the touch's; going back, nothing is left of it.
        ({"STAGE": f"{TOUCH} off: {{axes: {{z: {{move: 20 mm}}}}"}, []),
        ({"STAGE": f"{TOUCH} off: {{axes: {{z: {{move: -5 mm}}}}"}, ["TS321"]),
    ],
)
def test_surfaces(changes, expected):
    assert codes(**changes) == expected


@pytest.mark.parametrize(
    ("law", "stage", "expected"),
    [
        ("hybrid-multipliers", "path: {arc: {center: [0, 0], turns: 1}, time: 6 s}", []),
        ("hybrid-multipliers", "path: {arc: {center: [9 mm, 0], turns: 1}, time: 6 s}", ["TS323"]),
        ("hybrid", "path: {arc: {center: [9 mm, 0], turns: 1}, time: 6 s}", ["TS323"]),
        # x is not named, so it gives way to the rail.
        ("hybrid-multipliers", "axes: {y: {move: 20 mm}}", []),
        ("hybrid-multipliers", "axes: {y: {move: 20 mm}, x: hold}", ["TS323"]),
        ("hybrid", "axes: {y: {move: 20 mm}}", ["TS323"]),
        ("hybrid-multipliers", "axes: {z: {move: 20 mm}}", []),
    ],
)
def test_equations(law, stage, expected):
    assert codes(WORLD=RIM, FRAME="rail", LAW=law, STAGE=stage) == expected


@pytest.mark.parametrize(
    ("relation", "move", "expected"),
    [
        (">= 335 mm", "-10 mm", []),
        (">= 335 mm", "-20 mm", ["TS323"]),
        ("<= 355 mm", "-20 mm", []),
        ("<= 355 mm", "20 mm", ["TS323"]),
    ],
)
def test_one_side(relation, move, expected):
    world = f'lid: {{equation: "z {relation}"}}'
    assert codes(WORLD=world, STAGE=f"axes: {{z: {{move: {move}}}}}") == expected


def test_an_equation_without_a_gradient_on_the_way():
    slot = 'slot: {equation: "(x - 500 mm)^2 <= (40 mm)^2"}'
    assert codes(WORLD=slot, STAGE="path: {line: {by: [-40 mm]}, time: 2 s}") == ["TS324"]


def test_a_run_presses_as_hard_as_said(simulate):
    task = text(STAGE="axes: {z: {move: -40 mm}}")
    (found,) = findings(task)
    said = float(re.search(r"about ([\d.]+) N", found.message)[1])
    # Two digits; the mass felt at the start and 30 mm lower differ by less than that.
    assert -simulate(task)["force.z"][-1] == pytest.approx(said, rel=0.05)
