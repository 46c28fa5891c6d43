"""Small dense linear algebra on CasADi expressions.

Written out because CasADi factorises a symbolic SX matrix by QR, at three times the operations of
the Cholesky factor that a positive definite matrix has.
"""

from __future__ import annotations

import casadi as ca


def cholesky(A: ca.SX) -> ca.SX:
    """Lower L with L L^T = A. Reads only the upper triangle of A, positive definite (n, n)."""
    n = A.shape[0]
    L = ca.SX.zeros(n, n)
    for j in range(n):
        L[j, j] = ca.sqrt(A[j, j] - ca.sumsqr(L[j, :j]) if j else A[j, j])
        for i in range(j + 1, n):
            rest = ca.dot(L[i, :j].T, L[j, :j].T) if j else 0
            L[i, j] = (A[j, i] - rest) / L[j, j]
    return L


def forward(L: ca.SX, B: ca.SX) -> ca.SX:
    """L^-1 B for lower triangular L (n, n) and B (n, k)."""
    rows: list[ca.SX] = []
    for i in range(L.shape[0]):
        row = B[i, :]
        for j in range(i):
            row = row - L[i, j] * rows[j]
        rows.append(row / L[i, i])
    return ca.vertcat(*rows)


def backward(L: ca.SX, B: ca.SX) -> ca.SX:
    """L^-T B for lower triangular L (n, n) and B (n, k)."""
    n = L.shape[0]
    rows: list[ca.SX] = [ca.SX()] * n
    for i in reversed(range(n)):
        row = B[i, :]
        for j in range(i + 1, n):
            row = row - L[j, i] * rows[j]
        rows[i] = row / L[i, i]
    return ca.vertcat(*rows)


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
