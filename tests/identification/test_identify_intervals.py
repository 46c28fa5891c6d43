"""Fits that come to the true values from afar, and intervals where noise does not make them."""

from __future__ import annotations

import math
from statistics import NormalDist

import pytest

from hidden_worlds import press, program, run, true
from taskspec_runner.errors import InputError
from taskspec_runner.identify import identify
from taskspec_runner.identify.outside import interval
from taskspec_runner.identify.residual import surprises
from taskspec_runner.identify.written import set_lines

NOISE = "{noise: {force: 0.15 N, torque: 8 mN*m}}"
#: Worlds in which a wrong delay once led to a friction of none, and to a damping at the bend.
AFAR = (
    {
        "world.bench.stiffness": "14.4 kN/m",
        "world.bench.friction": "0.135",
        "world.bench.xyz": "[0, 0, 300.6 mm]",
        "world.bench.rpy": "[-0.16 deg, 1.95 deg, 0]",
        "robot.sensor.bias": "[0.7 N, 0.7 N, -0.9 N, 6 mN*m, 11 mN*m, -45 mN*m]",
        "robot.sensor.delay": "2.86 ms",
        "robot.sensor.filter": "68 Hz",
    },
    {
        "world.bench.stiffness": "30.4 kN/m",
        "world.bench.damping": "26.4 N*s/m",
        "world.bench.friction": "0.133",
        "world.bench.xyz": "[0, 0, 298.6 mm]",
        "world.bench.rpy": "[-0.5 deg, 0.4 deg, 0]",
        "robot.sensor.bias": "[-0.5 N, 0.9 N, 0.13 N, 18 mN*m, -31 mN*m, -27 mN*m]",
        "robot.sensor.delay": "5.65 ms",
        "robot.sensor.filter": "167 Hz",
    },
)


@pytest.mark.parametrize("truth", AFAR)
def test_a_delay_leads_nowhere_else(truth: dict[str, str]) -> None:
    """Errors are those of the noise: below 4.5 deviations, but for one value in 150 000."""
    made, history = run(press(NOISE), truth, seed=3)
    found = identify(program(press(NOISE)), [history])
    counted = [each for each in found.estimates if not each.along and math.isfinite(each.high)]
    assert len(counted) > 10
    for each in counted:
        off = abs(each.value - true(made, each.path, each.index))
        assert off < 4.5 * each.deviation + 1e-12, each.name
    assert not any(each.surprising for each in found.residuals)


def test_intervals_without_noise_hold() -> None:
    """They are as wide as the arithmetic is wrong, and what is 0 in the file stays out of it."""
    truth = {
        "world.bench.stiffness": "21.97 kN/m",
        "world.bench.friction": "0.31",
        "world.bench.xyz": "[0, 0, 299.3 mm]",
    }
    made, history = run(press(), truth)
    found = identify(program(press()), [history])
    counted = [each for each in found.estimates if "sensor.filter" not in each.path]
    assert len(counted) > 10
    for each in counted:
        assert each.low <= true(made, each.path, each.index) <= each.high, each.name
    lines = list(set_lines(found))
    assert any("stiffness=21.97 kN/m" in line for line in lines)
    assert "--set 'robot.sensor.bias=[0, 0, 0, 0, 0, 0]'" in lines
    assert not any("payload" in line or "joint_" in line for line in lines)


@pytest.mark.parametrize("own", [1.0, 0.2, 0.0, -0.5, -3.0, -6.0])
def test_an_interval_at_a_bound_has_its_level_of_the_likelihood(own: float) -> None:
    """Of the normal likelihood about `own`, cut off at 0, it has 90 %."""
    normal = NormalDist(own, 1.0)
    low, high = interval(own, 1.0, NormalDist().inv_cdf(0.95), 0.0)
    assert low == 0.0
    beyond = normal.cdf(2 * own - high) / normal.cdf(2 * own)
    assert beyond == pytest.approx(0.1, rel=1e-6)


def test_an_interval_far_beyond_its_bound_narrows_like_an_exponential() -> None:
    """exp(-x |own|) of the likelihood is left beyond x."""
    _, high = interval(-40.0, 1.0, NormalDist().inv_cdf(0.95), 0.0)
    assert high == pytest.approx(math.log(10) / 40, rel=1e-3)


def test_an_interval_off_its_bound_has_both_sides() -> None:
    assert interval(3.0, 1.0, 2.0, 0.0) == (1.0, 5.0)


def test_noise_that_the_file_does_not_have_is_warned_of() -> None:
    """A sensor with four times the declared noise."""
    _, history = run(press("{noise: {force: 0.6 N, torque: 32 mN*m}}"), {})
    found = identify(program(press(NOISE)), [history], ["world.bench.stiffness"])
    excess = {each.channel: each.excess for each in found.residuals if each.surprising}
    assert {"force.x", "force.y", "force.z"} <= set(excess)
    assert excess["force.x"] == pytest.approx(4, rel=0.1)
    (line,) = surprises(found.residuals)
    assert "intervals are too narrow" in line


def test_a_what_that_names_nothing_says_what_can_be_named() -> None:
    made, history = run(press(), {})
    with pytest.raises(InputError, match=r"--what names nothing.*world\.bench\.stiffness"):
        identify(made, [history], [])
