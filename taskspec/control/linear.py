"""Small dense linear algebra on CasADi expressions.

A symmetric matrix is factorised by Cholesky and never handed to `ca.solve` itself, which does a
symbolic SX matrix by QR, at three times the operations. Given a triangular matrix, it substitutes.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca


def column(values: Sequence[float | ca.SX]) -> ca.DM | ca.SX:
    """(m,) of numbers, or of expressions where there is one among them."""
    if any(isinstance(value, ca.SX) for value in values):
        return ca.vertcat(*values)
    return ca.DM(values)


def cholesky(A: ca.SX) -> ca.SX:
    """Lower L with L L^T = A. Reads only the upper triangle of A, positive definite (n, n)."""
    return ca.chol(ca.densify(A)).T


def forward(L: ca.SX, B: ca.SX) -> ca.SX:
    """L^-1 B for lower triangular L (n, n) and B (n, k)."""
    return ca.solve(ca.tril(L), B)


def backward(L: ca.SX, B: ca.SX) -> ca.SX:
    """L^-T B for lower triangular L (n, n) and B (n, k)."""
    return ca.solve(ca.tril(L).T, B)


def solve(L: ca.SX, B: ca.SX) -> ca.SX:
    """A^-1 B for the Cholesky factor L of A."""
    return backward(L, forward(L, B))


def small_solve(A: ca.SX, B: ca.SX) -> ca.SX:
    """A^-1 B for a regular, small A (m, m) of any kind, by Cramer's rule up to m = 2."""
    m = A.shape[0]
    if m == 1:
        return B / A[0, 0]
    if m == 2:
        a, b, c, d = A[0, 0], A[0, 1], A[1, 0], A[1, 1]
        return ca.vertcat(ca.horzcat(d, -b), ca.horzcat(-c, a)) @ B / (a * d - b * c)
    return ca.solve(A, B)


def eigen(A: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Eigenvalues (n,) and orthonormal eigenvectors (n, n), as columns, of a symmetric A (n, n).

    By Jacobi's rotations, sweep after sweep; so many that what is left off the diagonal is rounding
    up to n = 6, as their convergence is quadratic.
    """
    n = A.shape[0]
    A, V = ca.densify(A), ca.SX.eye(n)
    for _ in range(_SWEEPS.get(n, 8)):
        for p in range(n):
            for q in range(p + 1, n):
                off, gap = 2 * A[p, q], A[q, q] - A[p, p]
                long = ca.fabs(gap) + ca.sqrt(gap**2 + off**2)
                # tan of the lesser angle that makes A[p, q] zero; 0 where it is.
                tan = ca.if_else(gap < 0, -off, off) / (long + (long == 0))
                cos = 1 / ca.sqrt(1 + tan**2)
                turn = ca.SX.eye(n)
                turn[p, p] = turn[q, q] = cos
                turn[p, q], turn[q, p] = tan * cos, -tan * cos
                A, V = turn.T @ A @ turn, V @ turn
    return ca.diag(A), V


#: Sweeps of Jacobi's rotations by the size of the matrix: one rotation solves two by two.
_SWEEPS = {1: 0, 2: 1, 3: 5, 4: 6}


def least_pivot(A: ca.SX) -> ca.SX:
    """The least pivot of a symmetric A (n, n): positive if and only if A is positive definite."""
    A, least = ca.densify(A), ca.SX(ca.inf)
    while A.shape[0]:
        least = ca.fmin(least, A[0, 0])
        A = A[1:, 1:] - A[1:, :1] @ A[:1, 1:] / A[0, 0]
    return least
