"""The design of coupled axes: eigenvalues as expressions, and the damping that modes get."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from taskspec.control import linear
from taskspec.geometry.axis import Axis, coupled
from taskspec.laws.coupled import least_eigenvalue, modal_damping, stretched, yielding_stiffness
from taskspec.laws.gains import Gain

RNG = np.random.default_rng(11)
T = 1e-3


def positive_definite(m, spread=1.0):
    A = RNG.normal(size=(m, m)) * np.geomspace(1, spread, m)
    return A @ A.T / m + 0.1 * np.eye(m)


def numbers(expression):
    return np.array(ca.evalf(ca.SX(expression)))


@pytest.mark.parametrize("m", [1, 2, 3, 4, 5, 6])
@pytest.mark.parametrize("spread", [1.0, 1e3])
def test_eigenvalues_as_expressions(m, spread):
    for A in (positive_definite(m, spread), np.eye(m), np.diag(RNG.uniform(size=m))):
        values, V = map(numbers, linear.eigen(ca.SX(A)))
        np.testing.assert_allclose(
            np.sort(values.ravel()), np.linalg.eigvalsh(A), atol=1e-13 * np.max(np.abs(A)) * m
        )
        np.testing.assert_allclose(V.T @ V, np.eye(m), atol=1e-13)
        np.testing.assert_allclose(
            V @ np.diag(values.ravel()) @ V.T, A, atol=1e-13 * np.max(np.abs(A)) * m
        )


def test_the_least_pivot_has_the_sign_of_the_least_eigenvalue():
    found = set()
    for _ in range(200):
        A = RNG.normal(size=(3, 3))
        A = A + A.T + 2 * np.eye(3)
        positive = float(numbers(linear.least_pivot(ca.SX(A)))[0, 0]) > 0
        assert positive == (np.linalg.eigvalsh(A)[0] > 0)
        found.add(positive)
    assert found == {True, False}


@pytest.mark.parametrize("m", [1, 2, 3, 6])
def test_every_mode_has_its_damping_ratio(m):
    M, K = positive_definite(m), 400 * positive_definite(m)
    D = np.array(modal_damping(M.tolist(), K.tolist(), 0.7, T))
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-np.linalg.solve(M, np.hstack([K, D]))]])
    s = np.linalg.eigvals(A)
    np.testing.assert_allclose(-s.real / np.abs(s), 0.7, rtol=1e-9)
    varies = [[ca.SX(x) for x in row] for row in K.tolist()]
    again = [[float(numbers(x)[0, 0]) for x in row] for row in modal_damping(M, varies, 0.7, T)]
    np.testing.assert_allclose(again, D, rtol=1e-11, atol=1e-11 * np.max(D))


def test_sampling_bounds_the_damping_of_a_mode():
    """With one axis it is min(2 z sqrt(h k), h / (3 T)), whoever computes it."""
    h, free = 3.0, 2.0
    for k in (1e3, 1e9):
        for mobility, most in ((None, h), (np.array([[1 / free]]), free)):
            expected = min(1.4 * np.sqrt(h * k), most / (3 * T))
            for stiffness in (k, ca.SX(k)):
                [[D]] = modal_damping([[h]], [[stiffness]], 0.7, T, mobility)
                assert float(numbers(D)[0, 0]) == pytest.approx(expected, rel=1e-12)


def test_a_force_stretches_coupled_springs_by_their_inverse():
    K = np.array([[800.0, 250.0], [250.0, 600.0]])
    gains = {"stiffness": {on: Gain(v, "file") for on, v in
                           {"x": 800.0, "y": 90.0, "z": 600.0, "xz": 250.0}.items()}}  # fmt: skip
    expected = np.linalg.solve(K, [3.0, -10.0])
    for wrap in (float, ca.SX):
        forces = {"x": wrap(3.0), "y": wrap(7.0), "z": wrap(-10.0)}
        found = [float(numbers(stretched(gains, a, forces))[0, 0]) for a in "xyz"]
        np.testing.assert_allclose(found, [expected[0], 7 / 90, expected[1]], rtol=1e-12)
    assert yielding_stiffness(gains, "z") == pytest.approx(600 - 250**2 / 800)
    assert yielding_stiffness(gains, "y") == 90.0


def test_entries_couple_axes_in_groups():
    assert coupled(["xz", "rxry", "zrx"]) == [("x", "z", "rx", "ry")]
    assert coupled(["xz", "rxry"]) == [("x", "z"), ("rx", "ry")]
    assert coupled(["x", "z"]) == []


def test_the_direction_of_the_least_eigenvalue():
    least, direction = least_eigenvalue([[1.0, 2.0], [2.0, 1.0]], (Axis.X, Axis.Z))
    assert least == pytest.approx(-1.0)
    assert direction["x"] == pytest.approx(-direction["z"])
