"""Further forms of the constrained dynamics (section 4.3.1), which `control.constrained` equals.

The projection of (4.78) and the reduced form (4.80)-(4.97), written from the chapter's equations:
second implementations, for tests alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from taskspec.control import linear


def projector(H_factor: ca.SX, J_phi: ca.SX) -> ca.SX:
    """P = I - J_phi^T (J_phi H^-1 J_phi^T)^-1 J_phi H^-1, (4.79): P^2 = P and P J_phi^T = 0."""
    Y = linear.forward(H_factor, J_phi.T)
    back = linear.backward(H_factor, Y)
    return ca.SX.eye(J_phi.shape[1]) - J_phi.T @ linear.solve(linear.cholesky(Y.T @ Y), back.T)


def acceleration(H_factor: ca.SX, bias: ca.SX, u: ca.SX, J_phi: ca.SX, gamma: ca.SX) -> ca.SX:
    """q'' (n,) of the constrained arm, (4.78)."""
    Y = linear.forward(H_factor, J_phi.T)
    mobility = linear.cholesky(Y.T @ Y)
    drive = projector(H_factor, J_phi) @ (u - bias) - J_phi.T @ linear.solve(mobility, gamma)
    return linear.solve(H_factor, drive)


@dataclass(frozen=True, slots=True)
class Reduction:
    """Coordinates theta = (q_1 - psi(q_2), q_2) of the constrained arm, (4.80)-(4.86).

    Attributes:
        T: (n, n), q' = T theta' (4.84), in the order (theta_1, theta_2); u_theta = T^T u (4.86).
        Gamma: (n,) T' theta' (4.87), from J_phi q'' = -gamma alone.
        m: number of constraints.
    """

    T: ca.SX
    Gamma: ca.SX
    m: int

    @property
    def eliminated(self) -> ca.SX:
        """T E_1^T (n, m): the directions of q_1."""
        return self.T[:, : self.m]

    @property
    def free(self) -> ca.SX:
        """T E_2^T (n, n - m): the motions that the constraint allows."""
        return self.T[:, self.m :]


def reduction(J_phi: ca.SX, gamma: ca.SX, first: Sequence[int]) -> Reduction:
    """The reduction with q_1 the coordinates numbered `first`; d phi / d q_1 has to be regular.

    T is built from J_phi at the actual q, so that E_2 T^T J_phi^T = 0 (4.94) holds off the
    constraint as well.
    """
    m, n = J_phi.shape
    rest = [i for i in range(n) if i not in first]
    permutation = ca.SX(ca.DM(np.eye(n)[[*first, *rest]].T))
    J_1, J_2 = J_phi[:, list(first)], J_phi[:, rest]
    upper = ca.horzcat(ca.SX.eye(m), -linear.small_solve(J_1, J_2))
    lower = ca.horzcat(ca.SX.zeros(n - m, m), ca.SX.eye(n - m))
    Gamma = ca.vertcat(-linear.small_solve(J_1, gamma), ca.SX.zeros(n - m))
    return Reduction(permutation @ ca.vertcat(upper, lower), permutation @ Gamma, m)


@dataclass(frozen=True, slots=True)
class ReducedDynamics:
    """H~ theta'' + n~ = T^T u + T^T J_phi^T lambda, (4.88)-(4.90); theta_1'' = 0."""

    H: ca.SX
    n: ca.SX


def reduced_dynamics(reduced: Reduction, H: ca.SX, bias: ca.SX) -> ReducedDynamics:
    """H~ = T^T H T and n~ = T^T (H Gamma + C q' + g), (4.89); H (n, n) full."""
    T = reduced.T
    return ReducedDynamics(T.T @ H @ T, T.T @ (H @ reduced.Gamma + bias))


def reduced_multipliers(
    reduced: Reduction, dynamics: ReducedDynamics, u: ca.SX, J_phi: ca.SX
) -> ca.SX:
    """lambda (m,) from the reduced form, (4.96); it equals (4.77)."""
    m, T = reduced.m, reduced.T
    force = dynamics.n - T.T @ u
    H_12, H_22 = dynamics.H[:m, m:], dynamics.H[m:, m:]
    against = force[:m]
    if H_22.shape[0]:
        against = against - H_12 @ linear.solve(linear.cholesky(H_22), force[m:])
    return linear.small_solve((T.T @ J_phi.T)[:m, :], against)
