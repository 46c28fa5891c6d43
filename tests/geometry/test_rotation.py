"""Rotations against Pinocchio's."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest

from taskspec.geometry import rotation

RNG = np.random.default_rng(1)
VECTORS = [RNG.normal(size=3) for _ in range(20)] + [np.zeros(3), np.array([1e-9, 0, 0])]


@pytest.mark.parametrize("w", VECTORS)
def test_exp_and_log(w):
    symbol = ca.SX.sym("w", 3)
    there = ca.Function("f", [symbol], [rotation.exp(symbol), rotation.log(rotation.exp(symbol))])
    R, back = (np.array(value) for value in there(w))
    np.testing.assert_allclose(R, pin.exp3(w), atol=1e-12)
    np.testing.assert_allclose(back.ravel(), pin.log3(pin.exp3(w)), atol=1e-9)


def test_log_is_differentiable_at_the_identity():
    w = ca.SX.sym("w", 3)
    slope = ca.Function("f", [w], [ca.jacobian(rotation.log(rotation.exp(w)), w)])
    np.testing.assert_allclose(np.array(slope(np.zeros(3))), np.eye(3), atol=1e-9)


def test_rpy_is_about_fixed_axes():
    roll, pitch, yaw = 0.3, -0.7, 1.9
    np.testing.assert_allclose(
        rotation.from_rpy((roll, pitch, yaw)), pin.rpy.rpyToMatrix(roll, pitch, yaw), atol=1e-15
    )
