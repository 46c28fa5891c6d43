"""Overshoot, settling time and time constant against closed forms; contact that is lost."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskspec_runner.cli.outcome import _response as told_of
from taskspec_runner.record.history import History
from taskspec_runner.verdict.response import contact_losses, response, responses, time_constant

PERIOD = 1e-3


def clock(seconds: float) -> np.ndarray:
    return np.arange(round(seconds / PERIOD)) * PERIOD


@given(st.floats(0.02, 0.3), st.floats(-50, 50), st.floats(1, 30))
def test_first_order(constant: float, start: float, step: float) -> None:
    """y = r - D e^(-t/T) settles to 2 % of D at T ln 50, does not overshoot, and has T."""
    t = clock(3.0)
    target = start + step
    found = response(target - step * np.exp(-t / constant), np.full(len(t), target), PERIOD)
    assert found is not None
    assert found.step == pytest.approx(step, rel=1e-9)
    assert found.overshoot == pytest.approx(0.0, abs=1e-12) or found.overshoot is None
    wanted = constant * np.log(step / (0.02 * max(step, abs(target))))
    # The next tick after it.
    assert found.settling_time == pytest.approx(max(wanted, 0.0) + PERIOD / 2, abs=PERIOD)
    # A straight line through points of a straight line; what is left after 3 s, ten time
    # constants of the slowest, lies below the 2 % at which the fit ends.
    assert found.time_constant == pytest.approx(constant, rel=1e-6)


@pytest.mark.parametrize("damping", [0.1, 0.3, 0.5, 0.7])
def test_second_order(damping: float) -> None:
    """The overshoot is D e^(-pi z / sqrt(1 - z^2)); the hull has the time constant 1 / (z w)."""
    t, rate = clock(8.0), 12.0
    swing = rate * np.sqrt(1 - damping**2)
    phase = np.arccos(damping)
    error = np.exp(-damping * rate * t) * np.sin(swing * t + phase) / np.sin(phase)
    found = response(-15.0 * (1 - error), np.full(len(t), -15.0), PERIOD)
    assert found is not None
    wanted = 15.0 * np.exp(-np.pi * damping / np.sqrt(1 - damping**2))
    # A peak between two ticks is missed by at most its curvature, r (w T / 2)^2 / 2.
    assert found.overshoot == pytest.approx(wanted, abs=15 * (rate * PERIOD) ** 2)
    outside = np.flatnonzero(np.abs(error) > 0.02)
    assert found.settling_time == pytest.approx((outside[-1] + 1) * PERIOD)
    # The hull falls in steps, each at a peak, and the line through them is off by less than 2 %:
    # +0.3, +0.7, -1.0 and -1.9 % for these four.
    assert found.time_constant == pytest.approx(1 / (damping * rate), rel=0.02)


def test_a_ramp_counts_from_where_it_ends() -> None:
    """Behind a ramp of slope s the error is s T, and decays with T once the ramp has ended."""
    t, constant, slope = clock(2.0), 0.05, 100.0
    reference = np.minimum(slope * t, 20.0)
    end = 20.0 / slope
    lag = slope * constant * (1 - np.exp(-t / constant))
    after = slope * constant * (1 - np.exp(-end / constant)) * np.exp(-(t - end) / constant)
    found = response(reference - np.where(t < end, lag, after), reference, PERIOD)
    assert found is not None
    assert found.time_constant == pytest.approx(constant, rel=1e-3)
    assert found.settling_time == pytest.approx(end + constant * np.log(4.91 / 0.4), abs=2e-3)


def test_an_expectation_says_what_settled_is() -> None:
    t = clock(1.0)
    values, reference = 10 * (1 - np.exp(-t / 0.1)), np.full(len(t), 10.0)
    found = response(values, reference, PERIOD, (9.5, 11.0))
    assert found is not None
    assert found.tolerance == (0.5, 1.0)
    assert found.settling_time == pytest.approx(0.1 * np.log(20), abs=PERIOD)
    # One that the set point is outside of says nothing, nor does one that is far away.
    for bounds in ((0.0, 9.0), (0.0, 12.0), (None, 10.5)):
        aside = response(values, reference, PERIOD, bounds)
        assert aside is not None
        assert aside.tolerance == (0.2, 0.2)


def test_what_never_settles_and_what_does_not_decay() -> None:
    t = clock(2.0)
    found = response(10 + np.sin(20 * t), np.full(len(t), 10.0), PERIOD)
    assert found is not None
    assert (found.settling_time, found.time_constant) == (None, None)
    grows = np.exp(t)
    assert time_constant(grows, PERIOD) is None
    assert time_constant(np.zeros(100), PERIOD) is None
    # From one tick to the next is no decay that could be told from the sampling.
    assert time_constant(np.exp(-t / 1e-4), PERIOD) is None


def test_a_reference_that_does_not_stay_is_no_set_point() -> None:
    t = clock(1.0)
    wave = 10 + np.sin(9 * t)
    assert response(wave, wave, PERIOD) is None
    assert response(wave, np.full(len(t), np.nan), PERIOD) is None


def history(touching: list[int], **columns: np.ndarray) -> History:
    ticks = np.arange(len(touching))
    # Two visits of one stage.
    t = np.where(ticks < 5, ticks, ticks - 5) * PERIOD
    named = {name.replace("_", "."): column for name, column in columns.items()}
    found = {"t": t, "touching": np.array(touching, dtype=float), **named}
    return History(found, np.array(["press"] * len(ticks)))


def test_contact_is_lost_only_after_it_was_made() -> None:
    told = contact_losses(history([0, 0, 1, 1, 0, 0, 1, 0, 1, 0]), ["press"], PERIOD)
    # First visit: 0 0 1 1 0, one loss of a tick; second: 0 1 0 1 0, two of a tick each.
    assert told == {"press": {"losses": 3, "time": pytest.approx(3 * PERIOD)}}
    assert contact_losses(history([1, 0, 1]), [], PERIOD) == {}
    assert contact_losses(history([0, 0]), ["press"], PERIOD)["press"]["losses"] == 0


def test_of_several_visits_the_one_that_settled_last() -> None:
    values = np.array([0, 9, 10, 10, 10, 0, 0, 9, 10, 10], dtype=float)
    run = history([1] * 10, force_z=values, force_z_ref=np.full(10, 10.0))
    found = responses(run, {"press": {"force.z": None}}, PERIOD, {})["press"]["force.z"]
    assert found["settling_time"] == pytest.approx(3 * PERIOD)
    assert found["settled_within"] == "2 %"
    wide = {("press", "force.z"): (9.0, 11.0)}
    found = responses(run, {"press": {"force.z": None}}, PERIOD, wide)["press"]["force.z"]
    assert (found["settling_time"], found["settled_within"]) == (
        pytest.approx(2 * PERIOD), "expectation"
    )  # fmt: skip


@pytest.mark.parametrize("rate", [0.0, 40.0])
def test_a_set_point_that_is_set_meanwhile_is_a_step_from_there(rate) -> None:
    """Down from 12 N to 8 N at 1 s, jumping or at a rate: y follows first order, and never beyond.

    Behind a ramp of slope s the error ends as s T (1 - e^(-t_r/T)) and decays from there.
    """
    constant, t = 0.05, clock(2.0)
    since = t - 1.0
    lasts = 4.0 / rate if rate else 0.0
    moved = np.clip(since / lasts, 0, 1) if rate else (since >= 0).astype(float)
    push = 12.0 - 4.0 * moved
    decay = np.exp(-np.maximum(since, 0) / constant)
    if rate:
        lag = rate * constant * (1 - np.exp(-np.clip(since, 0, lasts) / constant))
        error = lag * np.exp(-np.maximum(since - lasts, 0) / constant)
        settled = lasts + constant * np.log(error.max() / 0.16)
    else:
        error, settled = np.where(since >= 0, 4.0 * decay, 0.0), constant * np.log(4.0 / 0.16)
    # It has risen from 0 to 12 N before, with a blow of 5 N.
    blow = 5 * np.exp(-(((t - 0.2) / 0.05) ** 2))
    values = -(push + error) * (1 - np.exp(-t / 0.02)) - blow
    log = {"t": t, "force.z": values, "force.z.ref": -push, "param.push": push}
    run = History(log, np.array(["press"] * len(t)))
    uses = {("press", "force.z"): ["param.push"]}
    found = responses(run, {"press": {"force.z": None}}, PERIOD, {}, uses)["press"]["force.z"]
    assert (found["set_point"], found["step"]) == (-8.0, pytest.approx(4.0, abs=1e-6))
    assert found["overshoot"] == pytest.approx(0.0, abs=1e-6)
    assert found["settling_time"] == pytest.approx(settled, abs=2 * PERIOD)
    assert found["time_constant"] == pytest.approx(constant, rel=1e-3)
    # Of a set point without that param it is a step from 0, which went 12 + 5 - 8 N beyond.
    other = responses(run, {"press": {"force.z": None}}, PERIOD, {})["press"]["force.z"]
    assert other["overshoot"] == pytest.approx(9.0, abs=0.01)


def test_what_is_no_step_has_no_overshoot() -> None:
    """From -14 N to -15 N there is a step of 7 %: a blow of 25 N beyond it is none of it."""
    t = clock(2.0)
    values = -15.0 + np.exp(-t / 0.1) * (1.0 - 26.0 * np.sin(40.0 * t))
    found = response(values, np.full(len(t), -15.0), PERIOD)
    assert found is not None
    assert found.overshoot is None
    from_free = response(values * (t > 0), np.full(len(t), -15.0), PERIOD)
    assert from_free is not None
    assert from_free.overshoot is not None
    assert from_free.overshoot > 10.0


def test_moments_are_not_told_in_newtons() -> None:
    """The force settled last is told; of moments where there are none, and none of a mechanism."""

    def found(settled: float, target: str = "set point") -> dict[str, object]:
        return {"settling_time": settled, "overshoot": 2.87, "target": target}

    both = {"force.z": found(0.2), "torque.rx": found(0.9), "bars.torque": found(1.2)}
    assert told_of(both) == ["2.87 N", "0.200 s (z)"]
    assert told_of({"bars.torque": found(1.2)}) == ["2.87 N*m", "1.200 s (bars)"]
    assert told_of({"crank.torque": found(1.2, "prediction")}) == ["-", "-"]
