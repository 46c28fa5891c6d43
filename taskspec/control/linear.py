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
