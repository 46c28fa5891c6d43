"""The sensor's equations: symbolic and numeric agree, and they do what their names say."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest

from sensors import RunningSensor
from taskspec.program.sensor import SensorModel
from taskspec.spec import Sensor

PERIOD = 1e-3
MODELS = [
    SensorModel(delay, hold, pole) for delay in (0, 1, 3) for hold in (1, 4) for pole in (0.0, 0.9)
]


def symbolic(model, wrenches):
    """The response from the symbolic update, started at zero."""
    memory = ca.SX.sym("memory", wrenches.shape[1], model.order)
    wrench, samples = ca.SX.sym("wrench", wrenches.shape[1]), ca.SX.sym("samples")
    step = ca.Function("step", [memory, wrench, samples], model.update(memory, wrench, samples))
    state, seen = np.zeros((wrenches.shape[1], model.order)), []
    for k, w in enumerate(wrenches):
        state, y = step(state, w, k % model.hold_ticks == 0)
        seen.append(np.array(y).ravel())
    return np.array(seen)


def numeric(model, wrenches):
    sensor = RunningSensor(model, np.zeros(wrenches.shape[1]))
    return np.array([sensor.step(w) for w in wrenches])


@pytest.mark.parametrize("model", MODELS, ids=str)
def test_symbolic_and_numeric_agree(model):
    wrenches = np.random.default_rng(1).normal(size=(40, 6))
    # The same operations in the same order: to rounding.
    np.testing.assert_allclose(symbolic(model, wrenches), numeric(model, wrenches), atol=1e-14)


def test_the_default_passes_everything_unchanged():
    model = SensorModel.of(Sensor(), PERIOD)
    assert model.direct
    assert model.order == 0
    wrenches = np.random.default_rng(2).normal(size=(10, 6))
    np.testing.assert_array_equal(numeric(model, wrenches), wrenches)


@pytest.mark.parametrize(
    ("delay", "rate", "ticks", "hold"),
    [
        (0.0, None, 0, 1),
        (2e-3, 1000.0, 2, 1),
        (2.1e-3, 500.0, 3, 2),  # never faster than the file says
        (1e-4, 400.0, 1, 3),
        (0.0, 7000.0, 0, 1),  # the controller looks once a tick
    ],
)
def test_times_become_whole_ticks_on_the_slow_side(delay, rate, ticks, hold):
    model = SensorModel.of(Sensor(delay=delay, rate=rate), PERIOD)
    assert (model.delay_ticks, model.hold_ticks) == (ticks, hold)


def test_the_low_pass_is_exact_at_the_ticks():
    """A step of a first-order low-pass of corner f is 1 - exp(-2 pi f t) at t = (k + 1) T."""
    model = SensorModel.of(Sensor(filter=20.0), PERIOD)
    seen = numeric(model, np.ones((50, 1)))[:, 0]
    t = PERIOD * np.arange(1, 51)
    np.testing.assert_allclose(seen, 1 - np.exp(-2 * math.pi * 20.0 * t), rtol=1e-12)


@pytest.mark.parametrize("model", MODELS, ids=str)
def test_a_ramp_comes_as_late_as_the_lag(model):
    ramp = PERIOD * np.arange(2000.0)[:, None]
    seen = numeric(model, ramp)[:, 0]
    late = (ramp[:, 0] - seen)[-400:].mean()  # 100 whole periods of the hold
    # The model begins with the wrench of the step before: its tick is in the lag, not in here.
    assert late + PERIOD == pytest.approx(model.lag(PERIOD), rel=1e-9)


def test_a_sensor_at_rest_stays_at_rest():
    rest = np.arange(6.0)
    sensor = RunningSensor(SensorModel(3, 4, 0.9), rest)
    for _ in range(20):
        np.testing.assert_allclose(sensor.step(rest), rest, rtol=1e-15)
