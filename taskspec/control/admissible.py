"""Limits as bounds on one control period: accelerations and forces that can always be met again.

A bound on a position alone is met too late: the joint arrives with a velocity that no motor stops.
Each function here says how far one period may go so that the next one still has a way out.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

#: Share of what a motor has beside gravity that braking before a joint limit may take.
BRAKING = 0.5
_DECELERATIONS = (1e-3, 1e6)
#: A joint beyond its limit is led back with this time constant, in control periods.
_RETURN = 10.0
#: Nearer to its cap than this share, a contact force counts as this near.
_NEAREST = 1e-3


def braking_deceleration(
    torque_limit: NDArray[np.float64], gravity: NDArray[np.float64], H: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Deceleration (n,) that each joint is trusted to have [rad/s^2, m/s^2].

    Half of what its motor has beside gravity moves at its diagonal inertia; a number even where
    gravity takes everything, or nothing limits the torque.

    Args:
        torque_limit: (n,) [N m, N]. gravity: (n,) g. H: (n, n), both at the start pose.
    """
    spare = np.maximum(torque_limit - np.abs(gravity), 0.0)
    return np.asarray(np.clip(BRAKING * spare / np.diag(H), *_DECELERATIONS))


def joint_accelerations(
    q: ca.SX,
    v: ca.SX,
    room: tuple[ca.DM, ca.DM],
    fastest: ca.DM,
    braking: ca.DM,
    period: float,
) -> tuple[ca.SX, ca.SX]:
    """Least and greatest q'' (n,) after which the joints can still keep their limits.

    A velocity w after this period is viable where braking by a from then on ends inside:
    T w + w^2 / (2 a) <= x with the room x, so w <= a (sqrt(T^2 + 2 x / a) - T). A joint that keeps
    to it needs no more than a to keep to it again, for the period's position step is T w.

    Args:
        q, v: (n,) measured [rad, m], [rad/s, m/s]. room: (n,) lower and upper position limit.
        fastest: (n,) velocity limit. braking: (n,) a. period: T [s].
    """
    lower, upper = room
    rise = _viable(upper - q, fastest, braking, period)
    fall = _viable(q - lower, fastest, braking, period)
    return (-fall - v) / period, (rise - v) / period


def _viable(room: ca.SX, fastest: ca.DM, braking: ca.DM, period: float) -> ca.SX:
    """Greatest velocity towards a limit after this period (n,); negative beyond the limit."""
    inside = ca.fmax(room, 0)
    # a (sqrt(T^2 + 2 x / a) - T) without the difference of two large numbers for a great a.
    stopping = 2 * inside / (period + ca.sqrt(period**2 + 2 * inside / braking))
    return ca.fmin(stopping, fastest) + ca.fmin(room, 0) / (_RETURN * period)


def highest_push(cap: float, force: ca.SX, closing: ca.SX, mass: ca.SX, stiffness: float) -> ca.SX:
    """The greatest force [N] along a contact's normal after which its cap is not exceeded.

    Held from now on, a push u on the believed spring brings the contact force to at most
    u + sqrt((f - u)^2 + h k s^2); that this is the cap gives

        u = (cap + f) / 2 - h k s^2 / (2 (cap - f)).

    Free of damping, so the true contact stays below.

    Args:
        cap: [N]. force: f, contact force now [N]. closing: s, velocity into the object [m/s].
        mass: h along the normal [kg]. stiffness: k believed of the contact [N/m].
    """
    left = ca.fmax(cap - force, _NEAREST * cap)
    into = ca.fmax(closing, 0)
    return ca.fmin((cap + force) / 2, cap) - mass * stiffness * into**2 / (2 * left)
