"""Random quadratic programs, of the kinds that make active-set solvers stumble."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from taskspec.control.qp import QuadraticProgram
from taskspec.control.qp.quadratic_program import Array
from taskspec.native.quadratic import Workspace, workspace


def plain(rng: np.random.Generator) -> QuadraticProgram:
    """Bounds at random: some can be met, some cannot."""
    n, m = int(rng.integers(1, 8)), int(rng.integers(1, 30))
    middle, width = rng.normal(size=m) * rng.uniform(), rng.uniform(0.05, 1.5, m)
    return _program(rng, rng.normal(size=(m, n)), middle - width, middle + width)


def doubled(rng: np.random.Generator) -> QuadraticProgram:
    """Rows twice, with the sign turned, and over another length."""
    A, at = _met(rng)
    k = len(A) // 3
    A[k : 2 * k] = A[:k] * rng.choice([-1.0, 1.0, 0.01, -100.0], k)[:, None]
    at = A @ np.linalg.lstsq(A[:k], at[:k], rcond=None)[0] if k else at
    width = rng.uniform(0.0, 1.0, len(A)) * rng.integers(0, 2, len(A))
    return _program(rng, A, at - width, at + rng.uniform(0.0, 1.0, len(A)))


def equal(rng: np.random.Generator) -> QuadraticProgram:
    """Equalities, up to as many as unknowns, among inequalities; some stand twice."""
    A, at = _met(rng)
    lower, upper = at - rng.uniform(0.0, 1.0, len(A)), at + rng.uniform(0.0, 1.0, len(A))
    count = min(int(rng.integers(1, A.shape[1] + 1)), len(A))
    lower[:count] = upper[:count] = at[:count]
    if len(A) > count:
        A[count], lower[count], upper[count] = -2.0 * A[0], -2.0 * at[0], -2.0 * at[0]
    return _program(rng, A, lower, upper)


def degenerate(rng: np.random.Generator) -> QuadraticProgram:
    """Many bounds through one point, towards which the objective pulls."""
    A, at = _met(rng)
    below = rng.random(len(A)) < 0.5
    return _program(rng, A, np.where(below, at, -np.inf), np.where(below, np.inf, at))


def box(rng: np.random.Generator) -> QuadraticProgram:
    """Bounds of each unknown, rows of zeros, and rows of lengths from 1e-3 to 1e3."""
    n = int(rng.integers(1, 8))
    A = np.vstack([np.eye(n), np.zeros((2, n)), rng.normal(size=(4, n))])
    A *= 10.0 ** rng.uniform(-3, 3, len(A))[:, None]
    at = A @ rng.normal(size=n)
    size = np.linalg.norm(A, axis=1) + (np.arange(len(A)) == n)
    lower, upper = at - rng.random(len(A)) * size, at + rng.random(len(A)) * size
    return _program(rng, A, lower, upper)


def contradicting(rng: np.random.Generator) -> QuadraticProgram:
    """A sum of rows that is bounded off what the rows let it be."""
    A, at = _met(rng)
    A = np.vstack([A, np.sum(A[:3], axis=0)])
    lower, upper = np.append(at, 0.0) - 0.5, np.append(at, 0.0) + 0.5
    lower[-1] = np.sum(upper[:3]) + rng.uniform(0.01, 1.0)
    upper[-1] = np.inf
    order = rng.permutation(len(A))
    return _program(rng, A[order], lower[order], upper[order])


def parallel(rng: np.random.Generator) -> QuadraticProgram:
    """Rows that are turned against others by 1e-9 to 1e-3 rad."""
    A, at = _met(rng)
    k = len(A) // 2
    A[k : 2 * k] = A[:k] + rng.normal(size=(k, A.shape[1])) * 10.0 ** rng.uniform(-9, -3, (k, 1))
    width = rng.uniform(0.0, 1.0, (2, len(A)))
    x = np.linalg.lstsq(A, at, rcond=None)[0]
    return _program(rng, A, A @ x - width[0], A @ x + width[1])


#: Whose verdicts do not hang on rounding.
CLEAR = (plain, doubled, equal, degenerate, box, contradicting)
Make = Callable[[np.random.Generator], QuadraticProgram]


def _met(rng: np.random.Generator) -> tuple[Array, Array]:
    """Rows, and what they are at some point."""
    n, m = int(rng.integers(2, 8)), int(rng.integers(3, 30))
    A = rng.normal(size=(m, n))
    return A, A @ rng.normal(size=n)


def _program(rng: np.random.Generator, A: Array, lower: Array, upper: Array) -> QuadraticProgram:
    """With a Hessian whose condition number is up to 1e4, and a wish that is mostly refused."""
    n = A.shape[1]
    turn = np.linalg.qr(rng.normal(size=(n, n)))[0]
    P = turn @ np.diag(10.0 ** rng.uniform(-2, 2, n)) @ turn.T
    P = np.ascontiguousarray((P + P.T) / 2)
    g = -P @ (3.0 * rng.normal(size=n)) * rng.integers(0, 2)
    return QuadraticProgram(P, g, np.ascontiguousarray(A), lower.copy(), upper.copy())


def loaded(problem: QuadraticProgram) -> Workspace:
    """A workspace on the arrays of a program."""
    m, n = problem.A.shape
    c = workspace(n, m)
    c.P, c.g, c.A = problem.P, problem.g, problem.A
    c.lower, c.upper = problem.lower, problem.upper
    return c
