"""The stop controller against closed forms: its energy, its torques, its steps."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from arms import MovingArm
from taskspec.control.stopping import DECAY, decay_time, stopping_torque, within_rate
from taskspec.robot.model_terms import PinocchioTerms

Vector = NDArray[np.float64]

UNLIMITED = 1e9


@pytest.mark.parametrize("name", ["panda", "ur5e", "planar3"])
def test_every_arm_loses_its_energy_at_one_rate(name: str) -> None:
    """K = K0 exp(-2 t / T) while nothing touches it, whatever C q' is on the way."""
    robot = MovingArm(name, 0).robot
    terms, n = PinocchioTerms(robot), robot.pin.nv
    most, rng = np.full(n, UNLIMITED), np.random.default_rng(3)
    q, v = 0.3 * rng.normal(size=n), rng.normal(size=n)

    def rates(state: Vector) -> Vector:
        terms.at(state[:n], state[n:])
        torque = stopping_torque(terms.inertia, terms.gravity, state[n:], most, DECAY)
        return np.concatenate([state[n:], np.linalg.solve(terms.inertia, torque - terms.bias)])

    def energy(state: Vector) -> float:
        terms.at(state[:n], state[n:])
        return 0.5 * float(state[n:] @ terms.inertia @ state[n:])

    state, h = np.concatenate([q, v]), 1e-3
    before = energy(state)
    for _ in range(100):
        a = rates(state)
        b = rates(state + h / 2 * a)
        c = rates(state + h / 2 * b)
        d = rates(state + h * c)
        state = state + h / 6 * (a + 2 * b + 2 * c + d)
    # Runge and Kutta's error over 2 T at h = T / 50 is some 100 h^5 / T^5 / 120 = 3e-9.
    assert energy(state) == pytest.approx(before * np.exp(-2 * 0.1 / DECAY), rel=1e-6)


def test_motors_keep_their_limits_and_never_drive() -> None:
    rng, cut = np.random.default_rng(4), 0
    for _ in range(500):
        n = int(rng.integers(1, 8))
        root = rng.normal(size=(n, n))
        inertia = root @ root.T + 0.1 * np.eye(n)
        most = rng.uniform(1.0, 20.0, n)
        gravity, v = rng.uniform(-0.9, 0.9, n) * most, rng.normal(size=n)
        torque = stopping_torque(inertia, gravity, v, most, DECAY)
        assert (np.abs(torque) <= most * (1 + 1e-12)).all()
        whole = -inertia @ v / DECAY
        # What is left is one share of the damper, which takes energy out.
        share = (torque - gravity) @ whole / (whole @ whole)
        np.testing.assert_allclose(torque - gravity, share * whole, atol=1e-9 * most.max())
        assert 0 <= share <= 1 + 1e-12
        assert v @ (torque - gravity) <= 1e-9
        cut += share < 1
    assert cut > 100


def test_arm_that_rests_is_carried_and_no_more() -> None:
    gravity, most = np.array([3.0, -50.0]), np.array([10.0, 40.0])
    torque = stopping_torque(np.eye(2), gravity, np.zeros(2), most, DECAY)
    np.testing.assert_array_equal(torque, [3.0, -40.0])


def test_held_damper_does_not_overshoot() -> None:
    """A velocity that is damped by a torque held for a period h goes by 1 - h / T."""
    assert decay_time(1e-3) == DECAY
    for period in (1e-3, 1e-2, 5e-2):
        assert 0.8 <= 1 - period / decay_time(period) + 1e-12 < 1


def test_a_joint_that_nobody_measures_is_carried_and_nothing_is_driven() -> None:
    rng = np.random.default_rng(6)
    for _ in range(300):
        n = int(rng.integers(2, 8))
        root = rng.normal(size=(n, n))
        inertia = root @ root.T + 0.1 * np.eye(n)
        gravity, v = rng.normal(size=n), rng.normal(size=n)
        unheard = rng.random(n) < 0.4
        # What it shows is of no use, however wrong it is.
        shown = np.where(unheard, 1e3, v)
        most = np.full(n, UNLIMITED)
        torque = stopping_torque(inertia, gravity, shown, most, DECAY, unheard)
        np.testing.assert_array_equal(torque[unheard], gravity[unheard])
        assert (torque - gravity) @ v <= 0


def test_a_rate_is_kept_but_by_what_no_motor_can() -> None:
    before, most = np.array([0.0, 5.0, -12.0]), np.array([10.0, 10.0, 10.0])
    torque = within_rate(np.array([3.0, 4.9, 0.0]), before, np.array([1.0, 1.0, 1.0]), most)
    np.testing.assert_allclose(torque, [1.0, 4.9, -10.0])
