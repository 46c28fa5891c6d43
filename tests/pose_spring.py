"""A spring in six dimensions by matrices alone: what bushings are held against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def skew(w: Matrix) -> Matrix:
    """The matrix of the product with w (3,)."""
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def turned(w: Matrix) -> Matrix:
    """Rodrigues' formula: (3, 3) of a rotation vector (3,)."""
    angle = float(np.linalg.norm(w))
    if angle < 1e-12:
        return np.eye(3) + skew(w)
    W = skew(w / angle)
    return np.eye(3) + np.sin(angle) * W + (1 - np.cos(angle)) * W @ W


def vector(R: Matrix) -> Matrix:
    """The rotation vector (3,) of (3, 3), by the quaternion."""
    w = np.sqrt(max(1 + np.trace(R), 0.0)) / 2
    v = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4 * w)
    size = float(np.linalg.norm(v))
    return 2 * v if size < 1e-12 else 2 * np.arctan2(size, w) / size * v


def inverse_left_jacobian(w: Matrix) -> Matrix:
    """(3, 3) from angular velocity to the rate of the rotation vector w (3,)."""
    angle, W = float(np.linalg.norm(w)), skew(w)
    if angle < 1e-6:
        return np.eye(3) - W / 2 + W @ W / 12
    factor = 1 / angle**2 - (1 + np.cos(angle)) / (2 * angle * np.sin(angle))
    return np.eye(3) - W / 2 + factor * W @ W


def coordinates(p: Matrix, R: Matrix, p_b: Matrix, R_b: Matrix) -> Matrix:
    """(6,) of a tip at p, R in a bushing with its rest pose at p_b, R_b."""
    return np.concatenate([R_b.T @ (p - p_b), vector(R_b.T @ R)])


def wrench(
    p: Matrix, R: Matrix, p_b: Matrix, R_b: Matrix, K: Matrix, D: Matrix, twist: Matrix
) -> Matrix:
    """(6,) on the tip, world axes: minus the gradient of xi^T K xi / 2, and the damper's."""
    xi, A = coordinates(p, R, p_b, R_b), np.eye(6)
    A[3:, 3:] = inverse_left_jacobian(xi[3:])
    J = A @ np.kron(np.eye(2), R_b.T)
    return -J.T @ (K @ xi + D @ J @ twist)


def roots(residual, size: int) -> Matrix:
    """Newton's method from zero on, with central differences."""
    x, step = np.zeros(size), 1e-6
    for _ in range(30):
        J = np.array(
            [(residual(x + d) - residual(x - d)) / (2 * step) for d in step * np.eye(size)]
        ).T
        change = np.linalg.solve(J, residual(x))
        x = x - change
        if np.abs(change).max() < 1e-12:
            return x
    raise AssertionError("no root")
