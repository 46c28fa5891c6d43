"""The controllers that bring an arm to rest when a run has been broken off."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from taskspec.native.kernel import Vector, Words, vector

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Time constant in which joint velocities decay, free of contact [s].
DECAY = 0.05
#: It is no shorter than so many control periods: a damper that is held for a period is stable
#: below one, and damps without overshoot from two of them on.
_PERIODS = 5.0


def decay_time(period: float) -> float:
    """Time constant at a control period [s]."""
    return max(DECAY, _PERIODS * period)


def stopping_torque(
    inertia: Array,
    gravity: Array,
    velocity: Array,
    most: Array,
    decay: float,
    unheard: Mask | None = None,
) -> Array:
    """Torques (n,) that carry the arm and take its motion away [N m, N].

    tau = g(q) - s H(q) q' / T

    Damped like its inertia, every arm loses its kinetic energy K at the same rate, whatever its
    pose: as C q' does no work on it, K' = -2 s K / T + q'^T tau_ext. Nothing else is followed, so
    what it presses on is let go. s is 1, or what the motors leave of it beside gravity: a share of
    a damper is a damper, where torques that are cut joint by joint need not be one.

    A joint that nobody measures is carried and not damped: tau = g - s P H P q' / T, where P is 0
    for such joints, which takes energy out as well, q'^T P H P q' >= 0.

    Args:
        inertia: (n, n) H [kg m^2, kg m, kg].
        gravity: (n,) what carries the arm [N m, N].
        velocity: (n,) of the joints [rad/s, m/s].
        most: (n,) that the motors can do, inf where there is no limit [N m, N].
        decay: T [s].
        unheard: (n,) joints whose velocity nobody knows; None for none.
    """
    n = len(gravity)
    silent = np.zeros(n, dtype=np.int64) if unheard is None else unheard.astype(np.int64)
    torque, packed = np.zeros(n), np.asarray(inertia)[np.tril_indices(n)]
    H, g, v, limit, silence, found = (
        vector(np.ascontiguousarray(each))
        for each in (packed, gravity, velocity, most, silent, torque)
    )
    stopping(H, g, v, limit, silence, decay, found, n)
    return torque


def stopping(
    inertia: Vector,
    gravity: Vector,
    velocity: Vector,
    most: Vector,
    unheard: Words,
    decay: float,
    torque: Vector,
    n: int,
) -> None:
    """Writes what `stopping_torque` gives; a kernel.

    The inertia is its lower triangle, row after row; unheard has a 1 for each joint that nobody
    measures.
    """
    share = 1.0
    for i in range(n):
        damping = 0.0
        for j in range(n):
            row, column = max(i, j), min(i, j)
            if unheard[j] == 0:
                damping += inertia[row * (row + 1) // 2 + column] * velocity[j]
        damping = 0.0 if unheard[i] != 0 else -damping / decay
        torque[i] = damping
        left = most[i] - gravity[i] if damping > 0.0 else most[i] + gravity[i]
        if damping != 0.0:
            share = min(share, max(left, 0.0) / abs(damping))
    for i in range(n):
        torque[i] = min(max(gravity[i] + share * torque[i], -most[i]), most[i])


def within(
    wanted: Vector, before: Vector, step: Vector, most: Vector, torque: Vector, n: int
) -> None:
    """Writes what `within_rate` gives; a kernel."""
    for i in range(n):
        near = min(max(wanted[i], before[i] - step[i]), before[i] + step[i])
        torque[i] = min(max(near, -most[i]), most[i])


def within_rate(torque: Array, before: Array, step: Array, most: Array) -> Array:
    """The torques (n,) nearest to `torque` that a rate allows [N m, N].

    Args:
        torque: (n,) wanted.
        before: (n,) of the tick before.
        step: (n,) the most that each changes in a tick.
        most: (n,) that the motors can do; what is beyond that comes back at once.
    """
    return np.asarray(np.clip(np.clip(torque, before - step, before + step), -most, most))


def slow(rate: Vector, step: Vector, n: int) -> None:
    """Makes commanded velocities those of the next tick, of an arm that is to come to rest.

    Kernel; see `slowed`.
    """
    for i in range(n):
        known = rate[i] if math.isfinite(rate[i]) else 0.0
        rate[i] = known - min(max(known, -step[i]), step[i])


def slowed(rate: Array, step: Array) -> Array:
    """Commanded velocities (n,) of the next tick, of an arm that is to come to rest.

    Args:
        rate: (n,) of this tick; what is no number is as good as rest [rad/s, m/s].
        step: (n,) the most that each changes in a tick, inf for no limit.
    """
    found = np.array(rate)
    slow(vector(found), vector(np.ascontiguousarray(step)), len(found))
    return found
