"""The controller that brings an arm to rest when a run has been broken off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
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
    inertia: Vector,
    gravity: Vector,
    velocity: Vector,
    most: Vector,
    decay: float,
    unheard: Mask | None = None,
) -> Vector:
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
    if unheard is not None:
        velocity = np.where(unheard, 0.0, velocity)
    damping = -(inertia @ velocity) / decay
    if unheard is not None:
        damping[unheard] = 0.0
    left = np.where(damping > 0, most - gravity, most + gravity)
    acts = damping != 0
    shares = np.maximum(left[acts], 0.0) / np.abs(damping[acts])
    share = min(1.0, float(shares.min(initial=1.0)))
    return np.asarray(np.clip(gravity + share * damping, -most, most))


def within_rate(torque: Vector, before: Vector, step: Vector, most: Vector) -> Vector:
    """The torques (n,) nearest to `torque` that a rate allows [N m, N].

    Args:
        torque: (n,) wanted.
        before: (n,) of the tick before.
        step: (n,) the most that each changes in a tick.
        most: (n,) that the motors can do; what is beyond that comes back at once.
    """
    return np.asarray(np.clip(np.clip(torque, before - step, before + step), -most, most))
