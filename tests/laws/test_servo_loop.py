"""Boundary of a force loop over a servo in closed form, where it is known otherwise."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from taskspec.laws.servo_loop import Contact, DrivenAxis, ServoLoop, ServoTiming

W, DELAY = 2 * math.pi * 20, 0.02
#: So quick that nothing is sampled, and an arm so heavy that no contact moves it.
LOOP = ServoLoop(
    ServoTiming(w=W, ratio=1.0, delay=DELAY, period=1e-4, tick=1e-4, step=1e-4),
    DrivenAxis.alone(1e9, W, 1.0),
    Contact(20e3),
)


def test_a_late_spring_has_the_boundary_of_the_textbook():
    """k / s (2 w s + w^2) / (s + w)^2 e^(-T s) has its gain at -180 degrees."""

    def lags(frequency: float) -> float:
        follows = 2 * math.atan(frequency / W) - math.atan(2 * frequency / W)
        # A command is held for half a period on the average, and a reading is one old; what moves
        # by steps is half of one ahead.
        return math.pi / 2 + follows + frequency * (DELAY + 1e-4)

    low, high = 1.0, 500.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if lags(middle) < math.pi else (low, middle)
    x = low / W
    gain = 20e3 / low * math.hypot(1, 2 * x) / (1 + x**2)
    least, rings = LOOP.least_damping()
    assert least == pytest.approx(gain, rel=2e-3)
    assert rings == pytest.approx(low / (2 * math.pi), rel=2e-3)


def test_it_grows_with_stiffness_and_delay_and_shrinks_with_damping():
    least, _ = LOOP.least_damping()
    assert replace(LOOP, contact=Contact(40e3)).least_damping()[0] == pytest.approx(2 * least)
    late = replace(LOOP, timing=replace(LOOP.timing, delay=2 * DELAY))
    assert late.least_damping()[0] > 1.5 * least
    assert replace(LOOP, contact=Contact(20e3, d=50.0)).least_damping()[0] < least
    assert LOOP.stiffness == pytest.approx(20e3, rel=1e-3)


def test_where_nothing_returns_a_force_there_is_no_boundary():
    assert not replace(LOOP, contact=Contact(0.0)).known


def test_an_exact_contact_is_the_limit_of_stiff_ones():
    """Then the drives are all that gives way."""
    light = LOOP.timing.along(3.0, Contact(math.inf))
    stiff = LOOP.timing.along(3.0, Contact(1e7, d=2e4))
    assert light.least_damping()[0] == pytest.approx(stiff.least_damping()[0], rel=0.01)
    assert light.stiffness == pytest.approx(3.0 * W**2)
