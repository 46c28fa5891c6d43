"""What stands beside a law, in the words of `explain`: each number by a closed form of its own."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from taskspec.compiler import compile_unchecked
from taskspec.explain import beside
from taskspec.laws.adaptation import Adaptation
from taskspec.spec import load_task, load_text
from taskspec.statics.held_body import held_bodies
from taskspec.statics.sliding_layer import sliding_layers
from taskspec_runner.cli.app import app
from taskspec_runner.cli.sheet.controller import controller_rows

TASKS = Path(__file__).parents[2] / "tasks"
PLANAR = """\
taskspec: 1
name: planar
robot:
  model: planar2
  start: {xyz: [400 mm, 100 mm, 0]}
  encoder: {resolution: 0.2 mrad}
  joint_friction: 0.5 N*m
world: {wall: {shape: plane, xyz: [402 mm, 0, 0], rpy: [0, -90 deg, 0], stiffness: 10 kN/m}}
control: CONTROL
law: LAW
stages:
  go: {axes: {x: {force: 5 N}, y: {move: 20 mm}}, time: 2 s}
"""


@pytest.fixture(scope="module")
def plans():
    """Plans of the stages of shipped tasks, each task planned once."""
    found = {}

    def of(task):
        if task not in found:
            program = compile_unchecked(load_task(TASKS / f"{task}.yaml"))
            found[task] = {stage.name: stage.plan for stage in program.stages}
        return found[task]

    return of


def planar(law="hybrid", control="{}"):
    """The plan of the one stage of a small task."""
    text = PLANAR.replace("CONTROL", control).replace("LAW", law)
    return compile_unchecked(load_text(text, "planar.yaml")).stages[0].plan


def test_a_body_that_is_held_and_when_it_slips(plans):
    stages = plans("pick-and-screw")
    assert dict(beside(stages["grasp"], stages))["grips"] == "cap, each jaw to press with 30 N"
    assert dict(beside(stages["let_go"], stages))["releases"] == "cap"
    assert dict(beside(stages["approach"], stages)) == {}
    (body,) = held_bodies(stages["carry"], stages)
    # mu (2 N - f), over the mass; the cap of 40 g rests on the pads, across their axis.
    # The move across has 10 mN along the jaws, which takes as much off one pad.
    assert 0 < body.along < 0.02
    assert body.holds == pytest.approx(0.5 * (2 * 30 - body.along))
    assert body.across >= 0.04 * 9.81
    rows = dict(beside(stages["carry"], stages))
    assert rows["holds"] == "cap of 40 g, each jaw presses with 30 N"
    assert rows["slips"].startswith("beyond 30 N across the jaws, which is |g + a| = 750 m/s^2")
    harder = held_bodies(stages["screw_down"], stages)
    assert [each.grip.force for each in harder] == [30.0, 65.0]
    for each in harder:
        needed = math.hypot(each.across / 2, 0.4 / (2 * 15e-3)) / 0.5 + each.along / 2
        assert each.needed == pytest.approx(needed)


def test_a_payload_and_what_of_it_gravity_shows(plans):
    stages = plans("unknown-payload")
    rows = dict(beside(stages["zero"], stages))
    assert rows["adapts"] == "to a payload of 0 g to 1 kg, its centre within 200 mm of the tip"
    # 1/(2 pi 0.5 Hz), and 0.1 N over g.
    assert "exp(-t/318 ms), 0.5 Hz, and at rest the mass comes within 10.2 g" in rows["estimate"]
    # The tool hangs straight down: its own axis is along gravity.
    assert rows["excites"] == (
        "by gravity along its planned motion mass and centre along x and y; "
        "centre along z by its accelerations at most"
    )
    assert rows["excites"] != dict(beside(stages["swing"], stages))["excites"]
    press = dict(beside(stages["press"], stages))
    assert press == {
        "payload": "goes by its estimate and leaves it as it is: the sensor at the wrist takes "
        "contact and payload for one"
    }


def test_what_a_gramian_leaves_of_an_error():
    adapted = Adaptation(0.0, 1.0, 0.2, 2.0, 0.1, inertia=True, gravity=(0, 0, -9.81), period=1e-3)
    along = np.array([0.6, 0.0, 0.8])
    gramian = np.zeros((4, 4))
    gramian[0, 0] = 1.0
    gramian[1:, 1:] = np.eye(3) - np.outer(along, along)
    gone = 1 - math.exp(-2.0 * 1.5)
    expected = [gone, gone * (1 - 0.36), gone, gone * (1 - 0.64)]
    assert adapted.shown(gramian, 1.5) == pytest.approx(expected, abs=1e-12)
    assert adapted.shown(gramian, math.inf) == pytest.approx([1.0, 0.64, 1.0, 0.36], abs=1e-9)


def test_a_stiffness_that_is_estimated_and_gains_that_follow(plans):
    rows = dict(beside(plans("press-unknown-pads")["on_soft"], {}))
    assert rows["estimates z"].startswith(
        "the contact's stiffness from 2 kN/m to 200 kN/m, begins with 20 kN/m; counts changes"
    )
    assert rows["follow z"].startswith("mass 0.3912 kg to ")
    # ln(200 / 2) / 50 and a tick.
    assert rows["follow z"].endswith("; there 93.1 ms after it is found at the latest")
    assert "estimates z" not in dict(beside(plans("press-unknown-pads")["across"], {}))


def test_a_tank_and_the_first_contact(plans):
    rows = dict(beside(plans("energy-tank")["lower"], {}))
    assert rows["tank"] == "holds 0.5 J, begins with 0.5 J; at most 0.4 W leave it"
    assert rows["first contact"].startswith("from rest along z with at most 70.7 mm/s; table")


def test_layers_and_what_they_hold():
    stage = planar("{kind: hybrid, sliding: {layer: 0.3 m/s, gain: 2 m/s^2}}")
    (layer,) = sliding_layers(stage)
    K_P, K_D = (stage.gains[name]["y"].value for name in ("K_P", "K_D"))
    slope = (K_D - math.sqrt(max(K_D**2 - 4 * K_P, 0.0))) / 2
    assert layer.bound == pytest.approx(0.3 / slope)
    assert layer.taken == pytest.approx((K_D - slope + 2 / 0.3) * 1e-3 * (1 + slope * 1e-3))
    ((name, text),) = beside(stage, {})
    assert name == "slides along y"
    assert f"{1e3 * layer.bound:.3g} mm, by a layer of 300 mm/s; gain 2 m/s^2" in text


@pytest.mark.parametrize(
    ("torque", "said"),
    [("5 N*m", "5 N*m of each joint"), ("[5 N*m, 3 N*m]", "5 N*m of joint 1, 3 N*m of joint 2")],
)
def test_what_an_observer_takes_off(torque, said):
    law = f"{{kind: hybrid, disturbance_observer: {{bandwidth: 20 Hz, torque: {torque}}}}}"
    ((name, text),) = beside(planar(law), {})
    assert name == "observes"
    assert text.startswith("disturbances up to 20 Hz, 7.96 ms behind them; takes off at most ")
    assert said in text


@pytest.mark.parametrize(
    ("velocity", "rows"),
    [
        ("measured", {}),
        (
            "differences",
            # r/T of the lines; half a period behind.
            {"velocity": "of positions, by differences; 0.5 ms behind what accelerates",
             "noise": "lines of encoders, 0.2 mrad apart, make it up to 200 mrad/s off"},
        ),
        (
            "{filter: 50 Hz}",
            # r (1 - b)/T and T (1 + b)/(2 (1 - b)), b = exp(-2 pi 50 Hz 1 ms) = 0.7304.
            {"velocity": "of positions, by filtered differences, corner at 50 Hz; 3.21 ms behind "
             "what accelerates",
             "noise": "lines of encoders, 0.2 mrad apart, make it up to 53.9 mrad/s off"},
        ),
    ],
)  # fmt: skip
def test_velocities_and_their_noise(velocity, rows):
    assert dict(controller_rows(planar(control=f"{{velocity: {velocity}}}").context)) == rows


def test_friction_that_is_compensated():
    ((name, text),) = controller_rows(planar(control="{friction: 80 %}").context)
    assert name == "friction"
    assert text.startswith("compensates 0.4 N*m of each joint: most of it from 10 mrad/s")


def test_a_task_without_any_of_it_has_no_row_more(plans):
    stages = plans("wipe-table")
    assert len(stages) > 2
    assert [row for plan in stages.values() for row in beside(plan, stages)] == []


def test_the_command_shows_them_as_words_and_as_data(tmp_path):
    path = tmp_path / "planar.yaml"
    path.write_text(
        PLANAR.replace("CONTROL", "{friction: 80 %}").replace(
            "LAW", "{kind: hybrid, disturbance_observer: 20 Hz}"
        )
    )
    shown = CliRunner().invoke(app, ["explain", str(path), "--static"])
    assert shown.exit_code == 0, shown.output
    assert "compensates 0.4 N*m of each joint" in " ".join(shown.output.split())
    assert "disturbances up to 20 Hz" in shown.output
    data = CliRunner().invoke(app, ["explain", str(path), "--static", "--format", "json"])
    stage = json.loads(data.stdout)["stages"][0]
    assert [each["name"] for each in stage["beside"]] == ["observes"]
