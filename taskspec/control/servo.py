"""The joint servo of a robot: how it follows commands, and what its drives exert.

The reference of a joint follows a set point r that moves at the rate z,

    q_m'' = w^2 (r - q_m) + 2 zeta w (z - q_m'),

and the drives hold the joints to it,

    tau = H q_m'' + b + K (q_m - q) + D (q_m' - q'),

where without a stiffness of the drives K = H w^2 and D = 2 zeta w H, with one K is diagonal and
D_i = 2 zeta sqrt(K_i H_ii).
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass

Array = NDArray[np.float64]

#: Time constants after which an error is nothing.
_DECAYED = 30.0


@dataclass(frozen=True, slots=True)
class ServoReference:
    """The reference of joints (n,), as it is before or after a tick of the servo.

    Attributes:
        r: set point [rad, m].
        q: reference [rad, m].
        v: its velocity [rad/s, m/s].
        a: its acceleration in the last tick [rad/s^2, m/s^2].
    """

    r: ca.SX
    q: ca.SX
    v: ca.SX
    a: ca.SX


@dataclass(frozen=True, slots=True)
class Following:
    """How a reference follows its set point.

    Attributes:
        frequency: w [rad/s].
        ratio: zeta.
        period: of the servo [s].
        transition: (4,) row by row, what a period makes of (r - q_m, z - q_m') while z is held.
        velocity, acceleration, jerk: (n,) the most of the reference, inf for no limit.
    """

    frequency: ca.SX
    ratio: ca.SX
    period: ca.SX
    transition: ca.SX
    velocity: ca.SX
    acceleration: ca.SX
    jerk: ca.SX

    def after(self, before: ServoReference, command: ca.SX, *, positions: bool) -> ServoReference:
        """The reference at the end of a tick.

        What limits take from a velocity is lost: the set point goes back to where the reference
        wants no more than it is given. A position stays where it is.

        Args:
            before: at the tick's begin.
            command: (n,) velocities in this tick, or positions at its end.
            positions: which of the two.
        """
        h, w, zeta = self.period, self.frequency, self.ratio
        if positions:
            z, r = (command - before.r) / h, command
        else:
            z = _within(command, -self.velocity, self.velocity)
            r = before.r + h * z
        e, rate = before.r - before.q, z - before.v
        free_q = r - (self.transition[0] * e + self.transition[1] * rate)
        free_v = z - (self.transition[2] * e + self.transition[3] * rate)
        wanted = (free_v - before.v) / h
        least = ca.fmax(-self.acceleration, before.a - h * self.jerk)
        most = ca.fmin(self.acceleration, before.a + h * self.jerk)
        v = _within(before.v + h * _within(wanted, least, most), -self.velocity, self.velocity)
        a = (v - before.v) / h
        limited = ca.logic_or(
            ca.logic_or(wanted < least, wanted > most), ca.fabs(free_v) > self.velocity
        )
        v, a = ca.if_else(limited, v, free_v), ca.if_else(limited, a, wanted)
        q = ca.if_else(limited, before.q + h * (before.v + v) / 2, free_q)
        if not positions:
            r = ca.if_else(limited, q + (a - 2 * zeta * w * (z - v)) / w**2, r)
        return ServoReference(r, q, v, a)


def _within(value: ca.SX, least: ca.SX, most: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(value, least), most)


def transition(frequency: float, ratio: float, period: float) -> Array:
    """(4,) row by row: what a period [s] makes of the errors of a reference and of its rate.

    Args:
        frequency: w [rad/s].
        ratio: zeta.
        period: [s].
    """
    sigma, turn = ratio * frequency, abs(1.0 - ratio**2) ** 0.5 * frequency * period
    cosine, sine = (math.cos, math.sin) if ratio < 1.0 else (math.cosh, math.sinh)
    c, s = cosine(turn), period * (sine(turn) / turn if turn else 1.0)
    rows = (c + sigma * s, s, -(frequency**2) * s, c - sigma * s)
    return math.exp(-sigma * period) * np.array(rows)


def excursions(frequency: float, ratio: float, period: float, ticks: int) -> tuple[float, float]:
    """The most acceleration and jerk [1/s] of a reference whose command changes by 1 a second.

    The command changes once in so many ticks of the servo, to and fro as it is worst. It is the
    sum of the sizes of what one change leaves in the ticks that are as late after theirs.

    Args:
        frequency: w [rad/s].
        ratio: zeta.
        period: of the servo [s].
        ticks: of it in a period of control.
    """
    step = transition(frequency, ratio, period).reshape(2, 2)
    slowest = frequency * (ratio - math.sqrt(max(ratio**2 - 1.0, 0.0)))
    count = ticks * math.ceil(_DECAYED / (slowest * period * ticks))
    errors = np.empty((count + 1, 2))
    errors[0] = 0.0, 1.0
    for i in range(count):
        errors[i + 1] = step @ errors[i]
    acceleration = -np.diff(errors[:, 1]) / period
    jerk = np.diff(acceleration, prepend=0.0) / period
    held = ticks * period
    most = (np.abs(each).reshape(-1, ticks).sum(axis=0).max() for each in (acceleration, jerk))
    return float(held * next(most)), float(held * next(most))


def overshoot(ratio: float) -> float:
    """By which share a reference with this damping ratio goes beyond what it comes to."""
    return math.exp(-math.pi * ratio / math.sqrt(1.0 - ratio**2)) if ratio < 1.0 else 0.0


def drive_gains(H: Any, frequency: Any, ratio: Any, stiffness: Any | None) -> tuple[Any, Any]:
    """K and D (n, n) of the drives, of numbers or of expressions.

    Args:
        H: (n, n) inertia [kg m^2, kg].
        frequency: w [rad/s].
        ratio: zeta.
        stiffness: of the drives [N m/rad, N/m], (n,) or of numbers one for all; None for what the
            frequency makes of H.
    """
    if stiffness is None:
        return frequency**2 * H, 2 * ratio * frequency * H
    if isinstance(H, ca.SX):
        return ca.diag(stiffness), ca.diag(2 * ratio * ca.sqrt(stiffness * ca.diag(H)))
    each = np.broadcast_to(np.array(stiffness), len(H))
    return np.diag(each), np.diag(2 * ratio * np.sqrt(each * np.diag(H)))


def growth(H: Array, K: Array, D: Array, period: float, steps: int) -> float:
    """By which factor a free arm's distance from a reference at rest grows in a period, at most.

    The torque is held for the period, in which the arm is integrated in so many steps: below one
    the servo is stable as it is sampled.

    Args:
        H, K, D: (n, n) inertia, stiffness and damping.
        period: of the servo [s].
        steps: of the plant in it.
    """
    n, h = len(H), period / steps
    pull = -np.linalg.solve(H, np.hstack([K, D]))
    one, none = np.eye(n), np.zeros((n, n))
    # Of (q, v, held torque), one step: v' = v + h a, q' = q + h v'.
    step = np.block([[one, h * one, h**2 * one], [none, one, h * one], [none, none, one]])
    held = np.block([[one, none], [none, one], [pull[:, :n], pull[:, n:]]])
    whole = (np.linalg.matrix_power(step, steps) @ held)[: 2 * n]
    return float(np.abs(np.linalg.eigvals(whole)).max())


def highest_frequency(ratio: float, period: float) -> float:
    """w [rad/s] below which a servo of a period [s] is stable, as `growth` has it of one step.

    Of the characteristic polynomial l^2 - (2 - 2 zeta x - x^2) l + 1 - 2 zeta x with x = w h the
    first root to leave the unit circle does so at -1, where x^2 + 4 zeta x = 4.
    """
    return 2.0 * (math.sqrt(ratio**2 + 1.0) - ratio) / period
