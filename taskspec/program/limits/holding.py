"""The torque that is held on a tick whose program has no answer. A kernel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.native.kernel import Record, Vector, Words
from taskspec.native.quadratic import SOLVED, Workspace, solve, workspace
from taskspec.program.limits.bounds import COMMAND, JOINT
from taskspec.program.limits.resolution import Resolution

Array = NDArray[np.float64]


class Holding(Record):
    """What holding works in, for n joints and a program of m rows, of which h are hard.

    Attributes:
        least: a program of n unknowns and h rows.
        n_hard: h.
        finite: 1 where the rows of this tick are numbers.
        hard: (h,) rows of commands and of joints.
        factor: (n, n) by rows, lower, by which an answer x of a program becomes a torque.
        law: (n,) of this tick, about which the rows are [N m].
        before: (n,) of the tick before [N m].
        wanted: (n,) to come near to [N m].
        most: (n,) greatest size [N m].
        step: (n,) the most that it changes in one period.
        near: (n,) gets the torque [N m].
    """

    least: Workspace
    n_hard: int
    finite: int
    hard: Words
    factor: Vector
    law: Vector
    before: Vector
    wanted: Vector
    most: Vector
    step: Vector
    near: Vector


def holding(resolution: Resolution, factor: Array, before: Array) -> Holding:
    """What holding works in, on the (n, n) factor of a stage and its (n,) torque before."""
    hard = [i for i, row in enumerate(resolution.rows) if row.kind in (COMMAND, JOINT)]
    most = np.array(resolution.commands.most, dtype=np.float64)
    n, least = len(most), workspace(len(most), len(hard))
    np.asarray(least.P)[:: n + 1] = 1.0
    law, wanted, near = np.zeros((3, n))
    return Holding(
        least=least,
        n_hard=len(hard),
        hard=np.array(hard, dtype=np.int64),
        factor=factor,
        law=law,
        before=before,
        wanted=wanted,
        most=most,
        step=np.array(resolution.commands.step, dtype=np.float64),
        near=near,
    )


def hold(c: Holding, limits: Workspace) -> int:
    """Writes the torque nearest to the one wanted that keeps limits; always 1.

    Torques and their rate are kept in any case. The joints' rows are kept with them, unless there
    is no answer to that either: numbers were not finite, or the rows collide. What a joint then
    does beyond its limits stops the run.
    """
    n, law, near = limits.n, c.law, c.near
    _nearest(c, c.wanted, n)
    if c.n_hard != 0 and c.finite != 0:
        g, x = c.least.g, c.least.x
        for i in range(n):
            e = law[i] - near[i]
            for k in range(i):
                e -= c.factor[i * n + k] * g[k]
            g[i] = e / c.factor[i * n + i]
        for r in range(c.n_hard):
            row = c.hard[r]
            for i in range(n):
                c.least.A[r * n + i] = limits.A[row * n + i]
            c.least.lower[r], c.least.upper[r] = limits.lower[row], limits.upper[row]
        if solve(c.least) == SOLVED:
            for i in range(n):
                e = law[i]
                for k in range(i + 1):
                    e += c.factor[i * n + k] * x[k]
                near[i] = e
    _nearest(c, near, n)
    return 1


def _nearest(c: Holding, torque: Vector, n: int) -> None:
    """Writes the torque within the range of this tick that is nearest to another one."""
    before, step, most, near = c.before, c.step, c.most, c.near
    for i in range(n):
        lowest = min(max(-most[i], before[i] - step[i]), most[i])
        highest = max(min(most[i], before[i] + step[i]), -most[i])
        near[i] = min(max(torque[i], lowest), highest)
