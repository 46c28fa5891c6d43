"""Limits as bounds on one control period: accelerations and forces that can always be met again.

A bound on a position alone is met too late: the joint arrives with a velocity that no motor stops.
Each function here says how far one period may go so that the next one still has a feasible
continuation.
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
#: Nearer to its cap than this share nu, a contact force counts as this near, so that a push that is
#: at its cap does not turn into a blow for closing a little more. The force may then exceed its cap
#: by 3 nu; see `highest_push`.
NEAREST = 1e-2


def braking_deceleration(
    torque_limit: NDArray[np.float64], gravity: NDArray[np.float64], H: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Deceleration (n,) that each joint is trusted to have [rad/s^2, m/s^2].

    Half of what its motor has beside gravity moves at its diagonal inertia; a number even where
    gravity takes everything, or nothing limits the torque.

    Args:
        torque_limit: (n,) [N m, N].
        gravity: (n,) g.
        H: (n, n), both at the start pose.
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
    jerk: ca.DM | None = None,
) -> tuple[ca.SX, ca.SX]:
    """Least and greatest q'' (n,) after which the joints can still keep their limits.

    A velocity w after this period is viable where braking by a from then on ends inside:
    T w + w^2 / (2 a) <= x with the room x, so w <= a (sqrt(T^2 + 2 x / a) - T). A joint that keeps
    to it needs no more than a to keep to it again, for the period's position step is T w.

    Where torques change at a limited rate, the joint goes on for half of the time a / j that
    braking takes to set in, w^2 / (2 a) + w (T + a / (2 j)) <= x; and the acceleration itself has
    to be such that it can be taken back before w is there, by the same formula.

    Args:
        q, v: (n,) measured [rad, m], [rad/s, m/s].
        room: (n,) lower and upper position limit.
        fastest: (n,) velocity limit.
        braking: (n,) a.
        period: T [s].
        jerk: (n,) j, how fast accelerations can be changed; None for at once.
    """
    lower, upper = room
    rise = _towards(upper - q, v, fastest, braking, period, jerk)
    fall = _towards(q - lower, -v, fastest, braking, period, jerk)
    # Beyond one limit, the return is as fast as the other one allows.
    rise = ca.fmax(rise, -fall)
    return -ca.fmax(fall, -rise), rise


def _towards(
    room: ca.SX, v: ca.SX, fastest: ca.DM, braking: ca.DM, period: float, jerk: ca.DM | None
) -> ca.SX:
    """Greatest acceleration (n,) towards a limit that is `room` (n,) away; negative beyond it."""
    inside = ca.fmax(room, 0)
    back = ca.fmax(ca.fmin(room, 0) / (_RETURN * period), -fastest)
    if jerk is None:
        return (ca.fmin(reach(inside, braking, period), fastest) + back - v) / period
    lag = period + braking / (2 * jerk)
    viable = reach(inside, braking, lag)
    # What is viable falls as the joint goes on.
    falling = braking * ca.fmax(v, 0) / (viable + braking * lag)
    return ca.fmin(
        approach(fastest - v, jerk, period), approach(viable + back - v, jerk, period) - falling
    )


def joint_velocities(
    q: ca.SX, room: tuple[ca.DM, ca.DM], fastest: ca.DM, slowing: ca.DM, lag: float
) -> tuple[ca.SX, ca.SX]:
    """Least and greatest q' (n,) that may be commanded so that joints stop before their limits.

    Args:
        q: (n,) where they are [rad, m].
        room: (n,) lower and upper position limit.
        fastest: (n,) velocity limit.
        slowing: (n,) deceleration that can be commanded, inf for no limit.
        lag: for how long a joint goes on before it slows down [s].
    """
    lower, upper = room

    def towards(left: ca.SX) -> ca.SX:
        back = ca.fmax(ca.fmin(left, 0) / lag, -fastest)
        return ca.fmin(reach(ca.fmax(left, 0), slowing, lag), fastest) + back

    rise, fall = towards(upper - q), towards(q - lower)
    # Beyond one limit, the return is as fast as the other one allows.
    rise = ca.fmax(rise, -fall)
    return -ca.fmax(fall, -rise), rise


def reach(room: ca.SX, slowing: ca.SX | ca.DM, lag: float | ca.DM) -> ca.SX:
    """The greatest w >= 0 with lag w + w^2 / (2 slowing) <= room."""
    # slowing (sqrt(lag^2 + 2 x / slowing) - lag), without the difference of two large numbers.
    return 2 * room / (lag + ca.sqrt(lag**2 + 2 * room / slowing))


def approach(room: ca.SX, jerk: ca.SX | ca.DM | None, period: float) -> ca.SX:
    """Greatest rate at which `room` may be used up over this period so that it is never exceeded.

    Args:
        room: left, negative beyond it.
        jerk: how fast the rate can be changed; None for at once.
        period: T [s].
    """
    if jerk is None:
        return room / period
    return ca.sign(room) * reach(ca.fabs(room), jerk, period)


def highest_push(cap: float, force: ca.SX, closing: ca.SX, mass: ca.SX, stiffness: float) -> ca.SX:
    """The greatest force [N] along a contact's normal after which its cap is not exceeded.

    Held from now on, a push u on the nominal spring brings the contact force to at most
    u + sqrt((f - u)^2 + h k s^2); that this is the cap gives

        u = (cap + f) / 2 - h k s^2 / (2 (cap - f)).

    Followed all the time, it closes the distance e = cap - f at h k s^2 = e (C - e), with C = 2 cap
    at most. Within e < nu cap the denominator stays, and h k s^2 fades like
    exp(-(nu cap - e) / (nu cap)). With y = (f - cap) / (nu cap) it is used up where
    C / (nu cap) exp(-1 - y) = 2 (y - 1): at y = 2.9 for nu = 0.01.

    Free of damping, so the true contact stays below.

    Args:
        cap: [N].
        force: f, contact force now [N].
        closing: s, velocity into the object [m/s].
        mass: h along the normal [kg].
        stiffness: nominal k of the contact [N/m].
    """
    left = ca.fmax(cap - force, NEAREST * cap)
    into = ca.fmax(closing, 0)
    return ca.fmin((cap + force) / 2, cap) - mass * stiffness * into**2 / (2 * left)
