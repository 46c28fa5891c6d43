"""Motions of a held mechanism against what it lets move, by rank and power."""

from __future__ import annotations

import numpy as np
import pytest

from taskspec.examination import check_task
from taskspec.program.world.mechanisms import mechanism_models
from taskspec.spec import load_text
from taskspec_runner.trial.check import check

TASK = """
taskspec: 1
name: yields
robot: {model: panda, grasp: thing.handle}
world:
  thing: {mechanism: KIND, xyz: [500 mm, -150 mm, 350 mm], handle: [0, 150 mm, 0], KNOB}
frame: FRAME
law: LAW
stages: {go: {axes: {AXES}, time: 1 s}}
"""
GOOD = {"KIND": "hinge", "KNOB": "knob: fixed", "FRAME": "thing.handle", "LAW": "hybrid"}
REST = "x: {force: 0}, z: {force: 0}, rx: {torque: 0}, ry: {torque: 0}"


def task(**changes):
    text = TASK
    for key, value in (GOOD | changes).items():
        text = text.replace(key, value)
    return load_text(text, "t")


@pytest.mark.parametrize(
    ("axes", "changes", "expected"),
    [
        # 50 mm/s on 150 mm are 19.1 deg/s; in the handle's frame a held rotation turns along.
        (f"y: {{velocity: 50 mm/s}}, rz: {{torque: 0}}, {REST}", {}, []),
        (f"y: {{velocity: 50 mm/s}}, rz: {{follows: thing}}, {REST}", {}, []),
        ("y: {velocity: 50 mm/s}", {}, []),
        ("x: {velocity: 50 mm/s}", {}, ["TS322"]),
        ("x: {velocity: 50 mm/s}", {"LAW": "impedance"}, []),
        ("rx: {velocity: 5 deg/s}", {}, ["TS322"]),
        ("z: {move: 20 mm}", {}, ["TS322"]),
        ("x: {velocity: -50 mm/s}", {"FRAME": "thing"}, ["TS322"]),
        ("x: {velocity: -50 mm/s}, y: {force: 0}, rz: {torque: 0}", {"FRAME": "thing"}, []),
        ("x: {velocity: -50 mm/s}, rz: {velocity: 40 deg/s}", {"FRAME": "thing"}, ["TS322"]),
        ("z: {velocity: 20 mm/s}", {"KIND": "slide"}, []),
        ("x: {velocity: 20 mm/s}", {"KIND": "slide"}, ["TS322"]),
        ("y: {force: 5 N}", {}, []),
    ],
)
def test_rates(axes, changes, expected):
    assert [d.code for d in check_task(task(AXES=axes, **changes))] == expected


@pytest.mark.parametrize(
    ("axes", "knob"),
    [
        ("x: {velocity: -50 mm/s}, rz: {torque: 0}", "knob: fixed"),
        ("x: {velocity: -50 mm/s}, rz: {velocity: 19.1 deg/s}", "knob: fixed"),
        ("x: {velocity: -50 mm/s}", "knob: free"),
    ],
)
def test_a_line_that_the_handle_leaves_is_found_by_the_trial(axes, knob):
    """In 1 s it leaves the line that y holds by 150 mm (1 - cos 18.6 deg) = 8 mm: motors saturate.

    Where the stage begins its rates are those of the mechanism, so no rule finds anything.
    """
    loaded = task(AXES=axes, FRAME="thing", KNOB=knob)
    assert check_task(loaded) == ()
    assert [d.code for d in check(loaded).findings] == ["TS427"]


@pytest.mark.parametrize("kind", ["hinge", "slide", "screw"])
def test_free_twists_are_how_the_handle_moves(kind):
    """Against differences of the handle's pose: Rz(s) h, z s, and both by the pitch."""
    pitch = "pitch: 10 mm/turn" if kind == "screw" else "knob: fixed"
    loaded = task(KIND=kind, KNOB=pitch, AXES="z: hold", FRAME="world")
    model = mechanism_models(loaded.task)["thing"]
    step = 1e-6

    def place(s):
        c, sine = np.cos(s), np.sin(s)
        turned = np.array([[c, -sine, 0], [sine, c, 0], [0, 0, 1]]) @ model.handle
        way = {"hinge": 0.0, "slide": s, "screw": model.lead * s}[kind]
        at = model.handle if kind == "slide" else turned
        return model.origin + model.rotation @ (at + np.array([0.0, 0.0, way]))

    rate = (place(step) - place(-step)) / (2 * step)
    T = model.free_twists(model.grip, model.grip)
    # A central difference errs by step^2 radius / 6 and by rounding 1e-16 / step.
    assert T[:3, 0] == pytest.approx(rate, abs=1e-9)
