"""Dynamics of an arm under holonomic constraints (section 4.3.1), as CasADi expressions.

phi(q) = 0 with m rows, J_phi = d phi / d q, and H q'' + C q' + g = u + J_phi^T lambda (4.75),
(4.76). `gamma` is what J_phi q'' has to cancel: J_phi' q', or for phi(q, t) also its partial
derivatives by time (4.126)-(4.128). `bias` is C q' + g.
"""

from __future__ import annotations

import casadi as ca

from taskspec.control import linear


def multipliers(H_factor: ca.SX, bias: ca.SX, u: ca.SX, J_phi: ca.SX, gamma: ca.SX) -> ca.SX:
    """lambda (m,) that keeps the constraint, (4.77).

    Args:
        H_factor: (n, n) Cholesky factor of H.
        bias: (n,).
        u: (n,) joint torques.
        J_phi: (m, n).
        gamma: (m,).
    """
    Y = linear.forward(H_factor, J_phi.T)
    free = linear.forward(H_factor, bias - u)
    return linear.solve(linear.cholesky(Y.T @ Y), Y.T @ free - gamma)


def eliminate(J_phi: ca.SX, gamma: ca.SX, directions: ca.SX, wanted: ca.SX) -> ca.SX:
    """The acceleration (n,) that keeps the constraint and differs from `wanted` along q_1 alone.

    With `directions` D = T E_1^T of (4.84) this is T E_2^T E_2 q'' + Gamma: the constraint decides
    the m coordinates of q_1, the others stay as wanted. D (n, m) may be directions of any m
    generalised coordinates, such as those of the tool.
    """
    return wanted - directions @ linear.small_solve(J_phi @ directions, J_phi @ wanted + gamma)
