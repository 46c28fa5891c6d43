"""Limits that collide: which of them are relaxed, and by how little. Kernels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from taskspec.control.qp import QuadraticProgram
from taskspec.control.qp.dual import sharing
from taskspec.native.kernel import Record, Vector, Words
from taskspec.native.quadratic import SOLVED, Workspace, solve, workspace
from taskspec.program.limits.bounds import PRECEDENCE

#: A step by less than this share of the widening is rounding.
_ROUNDING = 1e-6
#: What the least widening of bounds costs, from the first to the last in tens, beside
#: (x - x0)'(x - x0) with x0 of the step before. The more it costs the nearer it is to the least;
#: from far away that is too much for a solver, from near it is not (of 1148 collisions at random
#: all are found, 99.9 % to 1e-3).
_FIRST_COST, _LAST_COST = 1e4, 1e10
#: The unit of the widening [rad/s^2, N, m/s^2]: with it rows are of a common scale.
_UNIT = 100.0
#: A bound is widened by this much more than it takes, so that rounding leaves room [all units].
_SPARE = 1e-5
#: Kinds of limits; all but the first give way.
_LEVELS = len(PRECEDENCE)


class Relaxing(Record):
    """What relaxing works in, for a program of n unknowns and m rows.

    Attributes:
        wide: a program of n + 1 unknowns and 2 m rows.
        levels: (m,) place of each row's kind in `PRECEDENCE`.
        at: (n + 1,) the answer of the step before.
    """

    wide: Workspace
    levels: Words
    at: Vector


def relaxing(n: int, kinds: Sequence[str]) -> Relaxing:
    """What relaxing works in, for a program of n unknowns whose rows are of these kinds."""
    m = len(kinds)
    wide = workspace(n + 1, 2 * m)
    np.asarray(wide.P)[:: n + 2] = 1.0
    levels = np.array([PRECEDENCE.index(kind) for kind in kinds], dtype=np.int64)
    return Relaxing(wide=wide, levels=levels, at=np.zeros(n + 1))


def relax(problem: QuadraticProgram, kinds: Sequence[str]) -> bool:
    """Widens the bounds of a program as `widen` does; whether that succeeded."""
    program = sharing(problem)
    return bool(widen(relaxing(len(problem.g), kinds), program))


def widen(c: Relaxing, limits: Workspace) -> int:
    """Widens the bounds of limits that collide, as little as it takes, the last of them first.

    Every kind of limit is given, after those before it in `PRECEDENCE`, the smallest equal widening
    in its own units with which the program has an answer. 1 if that succeeded, else 0.
    """
    lower, upper = limits.lower, limits.upper
    for level in range(1, _LEVELS):
        some = False
        for r in range(limits.m):
            if c.levels[r] == level:
                some = True
        if some:
            widening = _least_widening(c, limits, level)
            if not math.isfinite(widening):
                return 0
            for r in range(limits.m):
                if c.levels[r] == level:
                    lower[r] -= widening
                    upper[r] += widening
    return 1


def _least_widening(c: Relaxing, limits: Workspace, level: int) -> float:
    """The least t with lower - t <= A x <= upper + t on the rows of a level, all before it kept.

    Infinite where there is none.
    """
    n, m, wide = limits.n, limits.m, c.wide.A
    above, below, g, x, at = c.wide.upper, c.wide.lower, c.wide.g, c.wide.x, c.at
    for r in range(m):
        unit = _UNIT if c.levels[r] == level else 0.0
        for i in range(n):
            wide[r * (n + 1) + i] = limits.A[r * n + i]
            wide[(m + r) * (n + 1) + i] = limits.A[r * n + i]
        wide[r * (n + 1) + n], wide[(m + r) * (n + 1) + n] = -unit, unit
        counts = c.levels[r] <= level
        above[r], below[r] = limits.upper[r] if counts else math.inf, -math.inf
        above[m + r], below[m + r] = math.inf, limits.lower[r] if counts else -math.inf
    for i in range(n + 1):
        at[i] = 0.0
    found, last, cost = math.inf, 0.0, _FIRST_COST
    while cost <= _LAST_COST:
        for i in range(n + 1):
            g[i] = -at[i]
        g[n] += cost
        if solve(c.wide) != SOLVED:
            break
        for i in range(n + 1):
            at[i] = x[i]
        last, found = found, max(_UNIT * at[n], 0.0)
        if last - found <= _ROUNDING * (1.0 + found):
            break
        cost *= 10.0
    return found * (1.0 + _ROUNDING) + _SPARE
