"""What equations, mechanisms, loose bodies, sensors and variations are once they are read."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from taskspec.expression import FloatAlgebra, evaluate
from taskspec.spec import LoadedTask, load_task, load_text
from taskspec.text.diagnostic import SpecError

OK = Path(__file__).parent.parent / "corpus" / "ok"
HEAD = "taskspec: 1\nrobot: {model: panda}\nstages: {wait: {time: 1 s}}\n"


def load(name: str) -> LoadedTask:
    return load_task(OK / f"{name}.yaml")


def world(text: str, more: str = "") -> LoadedTask:
    return load_text(f"{HEAD}{more}world: {{it: {{{text}}}}}\n", "task.yaml")


def residual(text: str, **at: float) -> float:
    constraint = world(f"equation: {text}").task.equations["it"].equation
    return evaluate(
        constraint.residual.tree,
        FloatAlgebra(),
        lambda name: ({"pi": 3.141592653589793} | at)[str(name)],
    )


def test_an_equation_is_left_minus_right_in_si() -> None:
    at = {"x": 0.3, "y": 0.4, "z": 0.0, "clock": 0.25}
    assert residual("x^2 + y^2 = (300 mm)^2", **at) == pytest.approx(0.25 - 0.09)
    assert residual("z >= 2 mm * sin(2*pi*clock*1 Hz)", **at) == pytest.approx(-0.002)
    assert residual("q1 + 2*q2 = 90 deg", q1=0.1, q2=0.2) == pytest.approx(0.5 - 1.5707963)


@pytest.mark.parametrize("relation", ["=", "<=", ">="])
def test_an_equation_knows_its_relation_quoted_or_not(relation: str) -> None:
    for text in (f"z {relation} 300 mm", f'"z {relation} 300 mm"'):
        assert world(f"equation: {text}").task.equations["it"].equation.relation == relation


def test_the_three_families_of_objects_keep_apart() -> None:
    task = load("equations").task
    assert {name: e.kind for name, e in task.equations.items()} == {
        "rim": "equation",
        "floor": "equation",
        "ceiling": "equation",
        "cam": "equation",
        "linkage": "joint equation",
    }
    assert not task.shapes
    assert load("mechanisms").task.mechanisms.keys() == {"crank", "drawer", "bolt"}
    assert load("sensing").task.shapes.keys() == {"belt", "part", "kept"}


def test_mechanisms_in_si() -> None:
    found = load("mechanisms").task.mechanisms
    crank, drawer, bolt = found["crank"], found["drawer"], found["bolt"]
    assert (crank.kind, drawer.kind, bolt.kind) == ("hinge", "slide", "screw")
    assert crank.stop == pytest.approx((-6.283185307, 18.849555922))
    assert drawer.stop == pytest.approx((-0.2, 0.2))
    assert bolt.lead == pytest.approx(2e-3 / 6.283185307)
    assert (crank.lead, drawer.lead) == (0, 0)
    assert crank.detent is not None
    assert crank.detent.width == pytest.approx(0.0872664626)
    assert (crank.angular, drawer.angular, bolt.angular) == (True, False, True)


@pytest.mark.parametrize(
    ("stop", "ends"),
    [
        ("0..90 deg", (0.0, math.pi / 2)),
        ("[0, 90 deg]", (0.0, math.pi / 2)),
        ("[-0.25 turn, 1 rad]", (-math.pi / 2, 1.0)),
        ("[-reach, reach]", (-math.pi / 6, math.pi / 6)),
        ("+- reach", (-math.pi / 6, math.pi / 6)),
    ],
)
def test_the_forms_of_a_stop(stop: str, ends: tuple[float, float]) -> None:
    made = world(f"mechanism: hinge, stop: {stop}", "params: {reach: 30 deg}\n")
    assert made.task.mechanisms["it"].stop == pytest.approx(ends, rel=1e-15)


def test_a_percentage_that_varies_is_a_share_of_the_value_in_the_file() -> None:
    vary = "vary: {world.it.stiffness: +- 10 %, world.it.xyz: [+- 5 %, 10 mm +- 20 %, 0]}\n"
    found = world("shape: plane, xyz: [-40 mm, 0, 0], stiffness: 20 kN/m", vary).task.vary
    (stiffness,) = found["world.it.stiffness"]
    x, y, _ = found["world.it.xyz"]
    assert stiffness is not None
    assert x is not None
    assert y is not None
    assert stiffness.ends(20e3) == pytest.approx((18e3, 22e3), rel=1e-14)
    assert x.ends(-0.04) == pytest.approx((-0.042, -0.038), rel=1e-14)
    assert y.ends(0.0) == pytest.approx((8e-3, 12e-3), rel=1e-14)


def test_sensor_in_si() -> None:
    robot = load("sensing").task.robot
    sensor = robot.sensor
    assert robot.grasp == "part"
    assert (sensor.at, sensor.rate, sensor.delay) == ("wrist", 500, 2e-3)
    assert sensor.noise is not None
    assert (sensor.noise.force, sensor.noise.torque) == (0.1, 5e-3)
    assert sensor.bias == (1, 0, -2, 0, 0.1, 0)


def test_a_bare_noise_is_that_of_the_forces() -> None:
    text = HEAD.replace("model: panda", "model: panda, sensor: {noise: 0.2 N}")
    noise = load_text(text, "task.yaml").task.robot.sensor.noise
    assert noise is not None
    assert (noise.force, noise.torque) == (0.2, 0)


def test_variations_of_mixed_dimensions() -> None:
    vary = load("sensing").task.vary
    force, *_, moment = vary["robot.sensor.bias"]
    assert force is not None
    assert moment is not None
    assert (force.high, moment.high) == (1.0, 0.02)
    assert vary["robot.sensor.bias"][1:5] == (None,) * 4


@pytest.mark.parametrize("free", ["true", "false"])
def test_only_a_loose_body_is_held(free: str) -> None:
    text = (
        f"taskspec: 1\nrobot: {{model: panda, grasp: part}}\nstages: {{wait: {{time: 1 s}}}}\n"
        f"world: {{part: {{shape: sphere, radius: 10 mm, free: {free}"
        f"{', mass: 1 kg' if free == 'true' else ''}}}}}\n"
    )
    if free == "true":
        assert load_text(text, "task.yaml").task.robot.grasp == "part"
        return
    with pytest.raises(SpecError, match="TS128"):
        load_text(text, "task.yaml")
