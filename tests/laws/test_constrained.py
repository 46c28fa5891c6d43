"""Constrained dynamics (4.75)-(4.97) and the multiplier laws against linear algebra in NumPy.

Random inertias, constraints and torques; matrices whose condition is below 1e3, so 1e-9 relative.
"""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from law_cases import gains_on

import constrained_forms
from taskspec.control import constrained, linear
from taskspec.laws import LAWS
from taskspec.laws.case import Case
from taskspec.laws.multipliers import Multipliers

RNG = np.random.default_rng(11)
SIZES = [(2, 1), (3, 1), (3, 2), (6, 2), (7, 3)]


def sx(array):
    return ca.SX(ca.DM(np.asarray(array, dtype=float)))


def value(expression):
    return np.array(ca.evalf(expression))


class Sample:
    """One random constrained arm: numbers and the same as expressions."""

    def __init__(self, n, m):
        A = RNG.normal(size=(n, n))
        self.n, self.m = n, m
        self.H = A @ A.T + n * np.eye(n)
        self.J = RNG.normal(size=(m, n))
        self.gamma, self.bias, self.u = (RNG.normal(size=k) for k in (m, n, n))
        self.factor = linear.cholesky(sx(self.H))

    def solve(self):
        """Acceleration and multipliers from the equations of motion themselves, (4.74), (4.75)."""
        K = np.block([[self.H, -self.J.T], [self.J, np.zeros((self.m, self.m))]])
        found = np.linalg.solve(K, np.concatenate([self.u - self.bias, -self.gamma]))
        return found[: self.n], found[self.n :]

    def symbols(self):
        return sx(self.bias), sx(self.u), sx(self.J), sx(self.gamma)


@pytest.fixture(params=SIZES, ids=str)
def sample(request):
    return Sample(*request.param)


def test_multipliers_and_acceleration(sample):
    """(4.77) and (4.78) solve (4.75) with J q'' = -gamma."""
    a, force = sample.solve()
    found = value(constrained.multipliers(sample.factor, *sample.symbols())).ravel()
    assert found == pytest.approx(force, rel=1e-9, abs=1e-9)
    found = value(constrained_forms.acceleration(sample.factor, *sample.symbols())).ravel()
    assert found == pytest.approx(a, rel=1e-9, abs=1e-9)


def test_projector(sample):
    """(4.79): P^2 = P, P J^T = 0, and its rank is n - m."""
    P = value(constrained_forms.projector(sample.factor, sx(sample.J)))
    assert pytest.approx(P, abs=1e-12) == P @ P
    assert pytest.approx(0, abs=1e-12) == np.abs(P @ sample.J.T).max()
    assert np.trace(P) == pytest.approx(sample.n - sample.m, abs=1e-10)


def test_every_choice_of_coordinates_gives_the_same_dynamics(sample):
    """(4.84)-(4.96): T, Gamma and the reduced multipliers, for every regular choice of q_1."""
    a, force = sample.solve()
    for first in itertools.combinations(range(sample.n), sample.m):
        if np.linalg.cond(sample.J[:, first]) > 50:
            continue
        reduced = constrained_forms.reduction(sx(sample.J), sx(sample.gamma), first)
        T, Gamma = value(reduced.T), value(reduced.Gamma).ravel()
        assert np.abs(sample.J @ T[:, sample.m :]).max() < 1e-10  # (4.94)
        assert sample.J @ Gamma == pytest.approx(-sample.gamma, abs=1e-10)
        dynamics = constrained_forms.reduced_dynamics(reduced, sx(sample.H), sx(sample.bias))
        H, n = value(dynamics.H), value(dynamics.n).ravel()
        m = sample.m
        theta = np.linalg.solve(H[m:, m:], (T.T @ sample.u - n)[m:])  # (4.93)
        assert T[:, m:] @ theta + Gamma == pytest.approx(a, rel=1e-8, abs=1e-8)
        again = constrained_forms.reduced_multipliers(reduced, dynamics, sx(sample.u), sx(sample.J))
        assert value(again).ravel() == pytest.approx(force, rel=1e-8, abs=1e-8)


def test_the_example_of_a_constraint_on_the_first_joints(sample):
    """(4.98)-(4.100): phi(q) = q_1 = 0, so that J = (I 0), T = I, H~ = H and n~ = C q' + g."""
    m, n = sample.m, sample.n
    sample.J, sample.gamma = np.eye(m, n), np.zeros(m)
    reduced = constrained_forms.reduction(sx(sample.J), sx(sample.gamma), range(m))
    assert np.array_equal(value(reduced.T), np.eye(n))
    dynamics = constrained_forms.reduced_dynamics(reduced, sx(sample.H), sx(sample.bias))
    assert value(dynamics.H) == pytest.approx(sample.H, abs=1e-12)
    assert value(dynamics.n).ravel() == pytest.approx(sample.bias, abs=1e-12)
    a, force = sample.solve()
    H_12, H_22, left = sample.H[:m, m:], sample.H[m:, m:], sample.u - sample.bias
    assert a[:m] == pytest.approx(0, abs=1e-12)
    assert H_22 @ a[m:] == pytest.approx(left[m:], abs=1e-9)  # (4.99)
    expected = -left[:m] + H_12 @ np.linalg.solve(H_22, left[m:])  # (4.100)
    assert force == pytest.approx(expected, abs=1e-9)
    found = constrained_forms.reduced_multipliers(reduced, dynamics, sx(sample.u), sx(sample.J))
    assert value(found).ravel() == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_elimination_is_the_reduced_form(sample):
    """T E_2^T E_2 q'' + Gamma, and nothing changes where the constraint is kept already."""
    first = range(sample.m)
    wanted = RNG.normal(size=sample.n)
    reduced = constrained_forms.reduction(sx(sample.J), sx(sample.gamma), first)
    kept = constrained.eliminate(sx(sample.J), sx(sample.gamma), reduced.eliminated, sx(wanted))
    T, Gamma = value(reduced.T), value(reduced.Gamma).ravel()
    expected = T[:, sample.m :] @ wanted[sample.m :] + Gamma
    assert value(kept).ravel() == pytest.approx(expected, abs=1e-9)
    again = constrained.eliminate(sx(sample.J), sx(sample.gamma), reduced.eliminated, kept)
    assert value(again).ravel() == pytest.approx(expected, abs=1e-9)


def closed_loop(sample, command):
    """q'' and lambda of the constrained arm under a command of joint accelerations."""
    a = value(command.joint_acceleration).ravel()
    u = sample.H @ a + sample.bias + value(command.joint).ravel()
    sample.u = u
    return sample.solve()


def on_constraint(sample, first, desired, measured, integral):
    reduced = constrained_forms.reduction(sx(sample.J), sx(sample.gamma), first)
    zero = np.zeros(sample.m)
    vectors = (sx(x) for x in (zero, desired, measured, integral))
    names = tuple(f"equation {i}" for i in range(sample.m))
    held = ca.SX.zeros(sample.n)
    directions = (sx(sample.J), sx(sample.gamma), reduced.eliminated)
    return Multipliers(names, *directions, *vectors, held), reduced


class Constrained(Case):
    """A case whose motion loops ask for given joint accelerations."""

    def joint_motion(self):
        return self.joint_velocity


def command_of(kind, on, wanted, **gains):
    nothing = SimpleNamespace(released=ca.SX(0, 1))
    given = gains_on(on.names, **gains, force__damping=1.0)
    return LAWS[kind].command(Constrained(None, nothing, given, sx(wanted), constraints=on))


def test_pi_on_multipliers(sample):
    """(4.106): q_2'' = v_2, lambda = lambda_d + K_lambda e + K_I int e."""
    m, wanted = sample.m, RNG.normal(size=sample.n)
    desired, measured, integral = (RNG.normal(size=m) for _ in range(3))
    on, reduced = on_constraint(sample, range(m), desired, measured, integral)
    k_p, k_i = RNG.uniform(0.1, 2, size=(2, m))
    command = command_of(
        "hybrid-multipliers", on, wanted, force__proportional=k_p, force__integral=k_i
    )
    a, force = closed_loop(sample, command)
    assert a[m:] == pytest.approx(wanted[m:], abs=1e-9)
    expected = desired + k_p * (desired - measured) + k_i * integral
    assert force == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert reduced.m == m


def test_p_on_reaction_torque(sample):
    """(4.121): E_1 T^T J^T (lambda - lambda_d) = K_F E_1 T^T J^T (lambda_d - lambda measured)."""
    m, wanted = sample.m, RNG.normal(size=sample.n)
    desired, measured = (RNG.normal(size=m) for _ in range(2))
    on, reduced = on_constraint(sample, range(m), desired, measured, np.zeros(m))
    k = RNG.uniform(0.1, 2, size=m)
    command = command_of("hybrid-reaction", on, wanted, force__proportional=k)
    a, force = closed_loop(sample, command)
    assert a[m:] == pytest.approx(wanted[m:], abs=1e-9)
    on_first = value(reduced.T)[:, :m].T @ sample.J.T
    expected = np.linalg.solve(on_first, k * (on_first @ (desired - measured)))
    assert force - desired == pytest.approx(expected, rel=1e-8, abs=1e-8)


def test_constant_gradients_damp_to_the_same_bits_by_numbers_and_by_parameters():
    """CasADi makes one number of a constant gradient and a constant gain; parameters must, too."""
    J = np.full((1, 3), 1 / np.sqrt(3.0))
    none, closing, gain = ca.SX.zeros(1), ca.SX.sym("closing"), ca.SX.sym("damping")
    on = Multipliers(("bars",), sx(J), none, sx(J.T), closing, none, none, none, ca.SX.zeros(3))
    found = []
    for damping in (gain, ca.DM(4.4979772559194755)):
        torque = on.command(ca.SX.zeros(3), ca.SX.zeros(3), damping, none).joint
        found.append(ca.Function("damped", [closing, gain], [torque]))
    for rate in RNG.normal(size=200):
        by_parameter, by_number = (np.array(f(rate, 4.4979772559194755)) for f in found)
        assert np.array_equal(by_parameter, by_number)
