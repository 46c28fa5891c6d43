"""Euler angles: T_e against finite differences, and laws in the analytical form.

Central differences with h = 1e-6 leave an error of the order h^2 f'''/6 + eps/h, below 1e-9 for
angles that stay 0.2 rad away from the singularity; 1e-7 is taken.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from law_cases import as_reference, command_of, gains_on

from taskspec.control import resolution, state
from taskspec.control.representation import REPRESENTATIONS, analytical
from taskspec.geometry.rotation import from_rpy
from taskspec.program.execution.compiled_terms import CompiledTerms
from taskspec.program.reference.orientation import (
    angles_of,
    displaced,
    rates_of,
    representation_of,
)
from taskspec.robot import load_robot, model_terms
from taskspec.spec import Law
from taskspec.spec.robot import Robot, Tool

RNG = np.random.default_rng(8)
NAMES = ("rpy", "zyz")


def number(expression):
    return np.array(ca.evalf(ca.SX(expression)))


def random_angles(name):
    """Angles at least 0.2 rad from the singularity."""
    first, third = RNG.uniform(-3, 3, 2)
    middle = RNG.uniform(-1.3, 1.3) if name == "rpy" else RNG.uniform(0.2, 2.9)
    return np.array([first, middle, third])


@pytest.mark.parametrize("name", NAMES)
def test_angles_and_matrix_are_inverse(name):
    representation = REPRESENTATIONS[name]
    for _ in range(50):
        phi = random_angles(name)
        R = number(representation.matrix(ca.SX(phi)))
        np.testing.assert_allclose(angles_of(representation, R), phi, atol=1e-12)
        if name == "rpy":
            np.testing.assert_allclose(R, from_rpy(phi), atol=1e-14)


@pytest.mark.parametrize("name", NAMES)
def test_rates_by_finite_differences(name):
    """w^ = R' R^T with w = T_e phi', and both the inverse and its derivative by time."""
    representation, h = REPRESENTATIONS[name], 1e-6
    for _ in range(50):
        phi, rate = random_angles(name), RNG.normal(size=3)
        R, before, after = (
            number(representation.matrix(ca.SX(phi + s * rate))) for s in (0, -h, h)
        )
        T = number(representation.rates(ca.SX(phi)))
        spin = (after - before) / (2 * h) @ R.T
        np.testing.assert_allclose(pin.unSkew(spin), T @ rate, atol=1e-7)
        inverse = number(representation.inverse(ca.SX(phi)))
        np.testing.assert_allclose(inverse @ T, np.eye(3), atol=1e-12)
        near = [number(representation.inverse(ca.SX(phi + s * h * rate))) for s in (-1, 1)]
        slope = number(representation.inverse_rate(ca.SX(phi), ca.SX(rate)))
        np.testing.assert_allclose((near[1] - near[0]) / (2 * h), slope, atol=1e-6)
        regular = float(number(representation.regularity(ca.SX(phi))).item())
        assert regular == pytest.approx(abs(np.linalg.det(T)), abs=1e-12)


class Reference6:
    """Numbers of a reference in frame axes; the rotation vector is the angular error."""

    def __init__(self, rng, size):
        self.error = rng.normal(size=6) * size
        self.velocity, self.acceleration = rng.normal(size=6) * 0.3, rng.normal(size=6)

    def symbolic(self):
        return as_reference(self.error, self.velocity, self.acceleration)


_BALL = Tool(shape="sphere", radius=0.01, length=0.12, mass=0.3)


class EulerArm:
    """A panda whose task is stated in Euler angles of its tool in the world."""

    def __init__(self, name):
        self.robot = load_robot(Robot(model="panda", tool=_BALL))
        n = self.robot.pin.nv
        self.v, self.w = ca.SX.sym("v", n), ca.SX.sym("w", 6)
        self.terms = terms = model_terms.symbols(self.robot, self.v)
        self.numeric = CompiledTerms(self.robot)
        self.state = state.task_state(
            axes=state.AXES,
            H=terms.H,
            J=terms.J,
            drift=terms.drift,
            twist=terms.twist,
            wrench=self.w,
            R=ca.SX.eye(3),
            R_rate=ca.SX.zeros(3, 3),
        )
        self.representation = REPRESENTATIONS[name]

    def stated(self, reference):
        return analytical(self.representation, self.state, reference.symbolic(), self.terms.R)

    def torque(self, task, law):
        zero = ca.SX.zeros(self.robot.pin.nv)
        terms = self.terms
        return resolution.torque(law(task), task.state, terms.H, terms.bias, terms.gravity, zero)

    def __call__(self, expressions, q, v, w):
        function = ca.Function("f", [self.v, self.w, *self.terms.inputs], list(expressions))
        self.numeric.at(q, v)
        return [np.array(x).squeeze() for x in function.call([v, w, *self.numeric.arrays])]

    def random(self):
        """A state whose tool is turned away from the singularity of ZYZ, which home is at."""
        q = self.robot.home + RNG.uniform(-0.3, 0.3, 7)
        q[5] -= 0.7
        return q, RNG.normal(size=7) * 0.5, RNG.normal(size=6) * 10


@pytest.mark.parametrize("name", NAMES)
def test_the_task_state_is_that_of_the_angles(name):
    """x' = J_a q' is d phi_e/dt and J_a' q' its rate at q'' = 0; power and mobility agree."""
    arm = EulerArm(name)
    task = arm.stated(Reference6(RNG, 0.1)).state
    h = 1e-6
    for _ in range(10):
        q, v, w = arm.random()
        J, drift, rate, f, mobility, J_g, twist, wrench = arm(
            [task.J, task.drift, task.velocity, task.f, task.mobility,
             arm.state.J, arm.state.velocity, arm.state.f], q, v, w,
        )  # fmt: skip
        phi = [
            angles_of(arm.representation, arm([arm.terms.R], q + s * v, v, w)[0]) for s in (-h, h)
        ]
        turned = np.unwrap(np.array(phi), axis=0)
        np.testing.assert_allclose((turned[1] - turned[0]) / (2 * h), rate[3:], atol=1e-7)
        near = [arm([task.J], q + s * v, v, w)[0] @ v for s in (-h, h)]
        # J_a grows to 1/sin(0.2) near the edge of the states: two digits more of h^2 f'''.
        np.testing.assert_allclose((near[1] - near[0]) / (2 * h), drift, atol=1e-5)
        np.testing.assert_allclose(J @ v, rate, atol=1e-12)
        np.testing.assert_allclose(J.T @ f, J_g.T @ wrench, atol=1e-10)
        assert f @ rate == pytest.approx(wrench @ twist, abs=1e-9)
        H_inverse = np.linalg.inv(_inertia(arm, q, v))
        np.testing.assert_allclose(mobility, J @ H_inverse @ J.T, rtol=1e-8, atol=1e-9)


def _inertia(arm, q, v):
    arm.numeric.at(q, v)
    return arm.numeric.inertia


@pytest.mark.parametrize("name", NAMES)
def test_impedance_is_linear_in_the_angles(name):
    """(4.15) in phi_e: H_m (phi'' - phi''_d) + D_m (phi' - phi'_d) + K_m (phi - phi_d) = f_a.

    Held against Pinocchio's forward dynamics; double precision through the inverse of a 6 by 6
    matrix whose condition is below 1e5, so 1e-7.
    """
    arm = EulerArm(name)
    M, K, D = (RNG.uniform(1, 5, 6) * s for s in (1, 200, 30))
    reference = Reference6(RNG, 0.3)
    task = arm.stated(reference)

    def law(found):
        gains = gains_on(state.AXES, mass=M, stiffness=K, damping=D)
        return command_of("impedance", found.state, found.reference, gains)

    u_symbol = arm.torque(task, law)
    data = arm.robot.pin.createData()
    for _ in range(10):
        q, v, w = arm.random()
        u, J, drift, rate, f, J_g, e, rate_d, acceleration_d = arm(
            [u_symbol, task.state.J, task.state.drift, task.state.velocity, task.state.f,
             arm.state.J, task.reference.error, task.reference.velocity,
             task.reference.acceleration], q, v, w,
        )  # fmt: skip
        qdd = pin.aba(arm.robot.pin, data, q, v, u + J_g.T @ w)
        apart = M * (J @ qdd + drift - acceleration_d) + D * (rate - rate_d) - K * e
        np.testing.assert_allclose(apart, f, rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_both_errors_agree_to_first_order(name):
    """phi_d - phi = T_e^-1 e_so3 + O(e^2): halving the error quarters what is left."""
    arm = EulerArm(name)
    q, v, w = arm.random()
    reference, left = Reference6(RNG, 1.0), []
    direction = reference.error / np.linalg.norm(reference.error[3:])
    for size in (1e-2, 5e-3):
        reference.error = direction * size
        task = arm.stated(reference)
        e, R = arm([task.reference.error, arm.terms.R], q, v, w)
        to = rates_of(Law(orientation=name), R)
        np.testing.assert_allclose(e[:3], reference.error[:3])
        left.append(np.linalg.norm(e[3:] - to @ reference.error[3:]))
    assert left[1] == pytest.approx(left[0] / 4, rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_references_are_the_rates_of_the_references_angles(name):
    """phi'_d and phi''_d of an orientation that turns by R_d(t) = Exp(a(t)) R_0."""
    representation, h = REPRESENTATIONS[name], 1e-4
    R0 = number(representation.matrix(ca.SX(random_angles(name) * 0.5 + 0.3)))
    axis = np.array([0.3, -0.5, 0.8])

    def turned(t):
        return pin.exp3(axis * (0.4 * t + 0.3 * t**2)) @ R0

    arm = EulerArm(name)
    reference = Reference6(RNG, 0.0)
    q, v, w = arm.random()
    R = arm([arm.terms.R], q, v, w)[0]
    reference.error[3:] = pin.log3(turned(0.0) @ R.T)
    reference.velocity[3:], reference.acceleration[3:] = axis * 0.4, axis * 0.6
    task = arm.stated(reference)
    rate, acceleration = arm([task.reference.velocity, task.reference.acceleration], q, v, w)
    a, b, c = np.unwrap([angles_of(representation, turned(t)) for t in (-h, 0, h)], axis=0)
    # h^2 f'''/6 and, of the second difference, 4 eps / h^2 = 1e-7.
    np.testing.assert_allclose((c - a) / (2 * h), rate[3:], atol=1e-6)
    np.testing.assert_allclose((c - 2 * b + a) / h**2, acceleration[3:], atol=1e-5)


@pytest.mark.parametrize("name", NAMES)
def test_a_displaced_orientation_has_the_displaced_angles(name):
    representation = REPRESENTATIONS[name]
    R = number(representation.matrix(ca.SX(random_angles(name))))
    error = np.array([0.1, -0.05, 0.2])
    found = number(displaced(representation_of(Law(orientation=name)), ca.SX(R), ca.SX(error)))
    np.testing.assert_allclose(
        angles_of(representation, found) - angles_of(representation, R), error, atol=1e-12
    )
    plain = number(displaced(representation_of(Law()), ca.SX(R), ca.SX(error)))
    np.testing.assert_allclose(plain, pin.exp3(error) @ R, atol=1e-15)
