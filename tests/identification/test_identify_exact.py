"""Without noise every value of a hidden world comes out to the last digits of the log."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hidden_worlds import PLANE, SWING, press, program, run, true
from taskspec.program.world.stiffness import added_mass
from taskspec_runner.identify import identify
from taskspec_runner.identify.model import LogModel, mobility
from taskspec_runner.identify.parameters import parameters_of

#: Each tick is a closed form of the log, whose numbers have 16 digits; a depth of 0.5 mm beside a
#: place of 0.5 m leaves 13, and differences of velocities over 1 ms some 10.
EXACT = 1e-7

_SHAPES = {
    "plane": PLANE,
    "cylinder": "cylinder, xyz: [450 mm, 100 mm, 260 mm], rpy: [0, 90 deg, 0], radius: 40 mm, "
    "length: 400 mm",
    "sphere": "sphere, xyz: [450 mm, 100 mm, 220 mm], radius: 80 mm",
    "box": "box, xyz: [450 mm, 100 mm, 270 mm], size: [300 mm, 300 mm, 60 mm]",
}


@pytest.mark.parametrize("shape", _SHAPES)
def test_contact_is_the_plants_own(shape: str) -> None:
    """The closed form of a contact is what the simulator's solver finds, tick by tick."""
    made, history = run(press(shape=_SHAPES[shape]), {})
    log = LogModel(made, history, "log")
    task = made.context.loaded.task
    own = log.own(log.contacts(task, mobility(made, task))["bench"], task)
    shown = log.shown(own, task)
    there = np.isfinite(log.readings).all(axis=1)
    assert np.abs(log.readings[there]).max() > 15.0
    # The solver's tolerance is 1e-14 of the arm's inertia; forces have 16 digits of 20 N.
    assert np.abs(shown - log.readings)[there].max() < 1e-9


@pytest.mark.parametrize("rates", ["{rate: 500 Hz}", "{rate: 500 Hz, plant_rate: 1 kHz}"])
def test_several_plant_steps_in_a_tick(rates: str) -> None:
    """The last of two steps is worked out from the positions of both ticks."""
    _, history = run(press() + f"control: {rates}\n", {"world.bench.stiffness": "22 kN/m"})
    found = identify(program(press() + f"control: {rates}\n"), [history])
    # With two steps the state between them is exact but for the acceleration's last digits.
    assert found.estimate("world.bench.stiffness").value == pytest.approx(22e3, rel=1e-5)


def test_a_press_without_noise() -> None:
    truth = {
        "world.bench.stiffness": "22 kN/m",
        "world.bench.damping": "70 N*s/m",
        "world.bench.friction": "0.42",
        "world.bench.xyz": "[0, 0, 301 mm]",
        "world.bench.rpy": "[0.5 deg, -1 deg, 0]",
        "robot.sensor.bias": "[0.4 N, 0, 0.8 N, 0, 10 mN*m, 0]",
        "robot.sensor.delay": "5 ms",
        "robot.sensor.filter": "80 Hz",
    }
    made, history = run(press(), truth)
    found = identify(program(press()), [history])
    for name, index in (
        ("world.bench.stiffness", None), ("world.bench.damping", None),
        ("world.bench.friction", None), ("world.bench.xyz", 2), ("world.bench.rpy", 0),
        ("world.bench.rpy", 1), ("robot.sensor.bias", 0), ("robot.sensor.bias", 2),
        ("robot.sensor.bias", 4), ("robot.sensor.delay", None), ("robot.sensor.filter", None),
    ):  # fmt: skip
        each = found.estimate(name if index is None else f"{name}.{index}")
        assert each.value == pytest.approx(true(made, name, index), rel=EXACT, abs=EXACT), name
    assert {"world.bench.xyz.0", "world.bench.xyz.1", "world.bench.rpy.2"} <= set(found.unseen)


def test_payload_and_joints_without_noise() -> None:
    truth = {
        "robot.payload": "{mass: 300 g, xyz: [10 mm, -5 mm, 30 mm]}",
        "robot.joint_friction": "0.4 N*m",
        "robot.joint_damping": "0.3 N*m*s/rad",
    }
    made, history = run(SWING, truth)
    found = identify(program(SWING), [history])
    names = [("robot.payload.xyz", i) for i in range(3)]
    plain = ("robot.payload.mass", "robot.joint_friction", "robot.joint_damping")
    for name, index in (*names, *((name, None) for name in plain)):
        each = found.estimate(name if index is None else f"{name}.{index}")
        assert each.value == pytest.approx(true(made, name, index), rel=EXACT), name


def test_a_tare_takes_the_bias() -> None:
    """Before a tare the bias shows, after it what the tare left is no value of the file."""
    text = press().replace("stages:\n", "stages:\n  zero: {tare: true, time: 0.3 s}\n")
    truth = {"robot.sensor.bias": "[0, 0, 2 N, 0, 0, 0]", "world.bench.stiffness": "30 kN/m"}
    _, history = run(text, truth)
    found = identify(program(text), [history])
    assert found.estimate("robot.sensor.bias.2").value == pytest.approx(2.0, rel=EXACT)
    assert found.estimate("world.bench.stiffness").value == pytest.approx(30e3, rel=EXACT)


def test_added_mass_is_what_a_plain_regression_leaves_out() -> None:
    """The force on depth and its rate alone is off by the mass that the simulator adds."""
    made, history = run(press(), {"world.bench.friction": "0"})
    on = history.stages == "press"
    z, v = (history.columns[f"{name}.z"][on] for name in ("position", "velocity"))
    f = -history.columns["force.z.measured"][on][1:]
    a = np.diff(v) / made.context.period
    mass = added_mass(made.context.robot.tool_body.mobility)
    regressors = np.column_stack([-z[:-1], -v[:-1], np.ones(len(a))])
    plain = np.linalg.lstsq(regressors, f, rcond=None)[0][0]
    whole = np.linalg.lstsq(regressors, f + mass * a, rcond=None)[0][0]
    # The mass counts J q'', and differences of the logged velocity have J' q' in them as well.
    assert whole == pytest.approx(15e3, rel=1e-5)
    # 6 N at 2.5 Hz: the spring seems softer by m w^2.
    assert abs(plain / 15e3 - 1) > 100 * abs(whole / 15e3 - 1)
    assert 15e3 - plain == pytest.approx(mass * (2 * math.pi / 0.4) ** 2, rel=0.2)


def test_all_parameters_have_names_and_units() -> None:
    names = [each.name for each in parameters_of(program(press()))]
    assert names
    assert len(names) == len(set(names))
    assert all(each.unit or "friction" in each.name for each in parameters_of(program(press())))
