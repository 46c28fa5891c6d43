"""Limits of torques, joints and the tip's speed, as bounds of the rows that keep them."""

from __future__ import annotations

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from taskspec.control import linear
from taskspec.control.admissible import (
    BRAKING,
    approach,
    braking_deceleration,
    joint_accelerations,
)
from taskspec.deferred_methods import dataclass
from taskspec.program.context import Context
from taskspec.program.limits.consistency import tangents
from taskspec.robot.model_terms import TermSymbols
from taskspec.spec import Limits
from taskspec.text.units import show

Vector = NDArray[np.float64]

#: Where limits collide, the one that comes first here is kept.
COMMAND, JOINT, FORCE, SPEED = "command", "joint", "force", "speed"
PRECEDENCE = (COMMAND, JOINT, FORCE, SPEED)

#: A limit that would stop the run is kept at this share, or this far inside.
SPEED_SHARE, VELOCITY_SHARE = 0.98, 0.99
POSITION_MARGIN = 1e-3
#: The tip's speed may turn aside by this share of its limit in one control period. With it
#: sqrt(1 + 2 * 0.1^2) * 0.98 = 0.99 of the limit are the most there is.
TURN_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class Row:
    """One limit: its kind, of `PRECEDENCE`, which of that kind, and what a reader calls it."""

    kind: str
    number: int
    text: str


#: Where a row of A comes from: of which piece, and which of its rows.
Source = tuple[str, int]


@dataclass(frozen=True, slots=True)
class CommandRange:
    """Bounds of every tick, with or without an answer of a program: commands and their rate.

    Attributes:
        most: (n,) greatest size of what each joint is commanded.
        step: (n,) the most that it changes in one period.
    """

    most: Vector
    step: Vector


class Bounds:
    """Rows with their bounds, one after the other."""

    def __init__(self) -> None:
        self.rows: list[Row] = []
        self.sources: list[Source] = []
        self.lower: list[ca.SX] = []
        self.upper: list[ca.SX] = []

    def add(self, kind: str, number: int, text: str, lower: ca.SX, upper: ca.SX) -> None:
        """Adds row `number` of a kind's matrix, what a reader calls it, and its bounds."""
        self.rows.append(Row(kind, number, text))
        self.sources.append((kind, number))
        self.lower.append(lower)
        self.upper.append(upper)


def add_torques(
    found: Bounds, context: Context, limits: Limits, wanted: ca.SX, last: ca.SX | None
) -> None:
    """Rows of the torques and their rate, around the torque `wanted` (n,) after `last` (n,)."""
    most = context.robot.torque_limit
    lowest, highest = ca.SX(ca.DM(-most)), ca.SX(ca.DM(most))
    if last is not None:
        assert limits.torque_rate is not None
        step = limits.torque_rate * context.period
        # A torque that is beyond its limit comes back at once.
        lowest, highest = (
            ca.fmin(ca.fmax(lowest, last - step), ca.DM(most)),
            ca.fmax(ca.fmin(highest, last + step), ca.DM(-most)),
        )
    for i in range(len(most)):
        if np.isfinite(most[i]) or last is not None:
            text = f"torque of joint {i + 1}"
            found.add(COMMAND, i, text, lowest[i] - wanted[i], highest[i] - wanted[i])


def add_joints(
    found: Bounds, context: Context, limits: Limits, q: ca.SX, v: ca.SX, acceleration: ca.SX
) -> None:
    """Rows of joint positions and velocities, around an acceleration (n,), at q, v (n,)."""
    robot, jerk = context.robot, None
    if limits.torque_rate is not None:
        # As with braking, the other half is for what the other joints do.
        jerk = ca.DM(BRAKING * limits.torque_rate / np.diag(context.start_inertia))
    braking = braking_deceleration(robot.torque_limit, context.start_gravity, context.start_inertia)
    least, greatest = joint_accelerations(
        q,
        v,
        (ca.DM(robot.lower + POSITION_MARGIN), ca.DM(robot.upper - POSITION_MARGIN)),
        ca.DM(VELOCITY_SHARE * robot.velocity_limit),
        ca.DM(braking),
        context.period,
        jerk,
    )
    for i, ends in enumerate(zip(robot.lower, robot.upper, robot.velocity_limit, strict=True)):
        if np.isfinite(ends).any():
            text = f"position and velocity of joint {i + 1}"
            found.add(JOINT, i, text, least[i] - acceleration[i], greatest[i] - acceleration[i])


def add_speed(
    found: Bounds,
    context: Context,
    limits: Limits,
    terms: TermSymbols,
    L: ca.SX,
    acceleration: ca.SX,
) -> ca.SX:
    """Rows that keep the tip's speed: along its motion, and aside from it.

    The velocity after this period lies in a box inside the ball of the limit, whose axis turns
    towards what the law commands. A plane across the motion alone lets the tip escape sideways:
    where the law commands T a > v aside, faster than it turns.

    Returns:
        (3, k) the unit vectors of the rows.
    """
    assert limits.speed is not None
    v, J, T = terms.twist[:3], terms.J[:3, :], context.period
    fastest = SPEED_SHARE * limits.speed
    aside, change = TURN_SHARE * fastest, T * (J @ acceleration + terms.drift[:3])
    ahead = _heading(v, v + change, aside)
    jerk = None
    if limits.torque_rate is not None:
        # The most that torques of size 1 do along the motion.
        most = ca.sum1(ca.fabs(linear.solve(L, J.T @ ahead)))
        jerk = BRAKING * limits.torque_rate * most
    rate, along = ca.dot(ahead, change) / T, ca.dot(ahead, v)
    found.add(
        SPEED,
        0,
        f"speed {show(fastest, 'mm/s')}",
        -approach(fastest + along, jerk, T) - rate,
        approach(fastest - along, jerk, T) - rate,
    )
    inside = ca.norm_2(v + change) < fastest
    across_it = sides(ahead, "z" in context.robot.axes)
    for i, side in enumerate(across_it):
        rate, across = ca.dot(side, change) / T, ca.dot(side, v)
        low, high = (-aside - across) / T - rate, (aside - across) / T - rate
        found.add(
            SPEED,
            i + 1,
            f"speed aside, {i + 1}",
            ca.if_else(inside, ca.fmin(low, 0), low),
            ca.if_else(inside, ca.fmax(high, 0), high),
        )
    return ca.horzcat(ahead, *across_it)


def _heading(v: ca.SX, wanted: ca.SX, aside: float) -> ca.SX:
    """Unit vector along `wanted`, turned back until v (3,) is no more than `aside` beside it."""
    size = ca.fmax(ca.norm_2(v), 1e-9)
    now, then = v / size, wanted / ca.fmax(ca.norm_2(wanted), 1e-9)
    turned = then - now * ca.dot(now, then)
    sine = ca.norm_2(turned)
    free = ca.logic_or(size <= aside, ca.logic_and(ca.dot(now, then) > 0, size * sine <= aside))
    least = ca.fmin(aside / size, 1)
    held = now * ca.sqrt(1 - least**2) + turned / ca.fmax(sine, 1e-9) * least
    found = ca.if_else(free, then, held)
    # Neither moving nor about to: any direction will do.
    return ca.if_else(ca.norm_2(found) > 0.5, found, ca.SX(ca.DM([1.0, 0.0, 0.0])))


def sides(ahead: ca.SX, spatial: bool) -> tuple[ca.SX, ...]:
    """Unit vectors (3,) across `ahead`: the one in the plane of a planar arm, else two."""
    if not spatial:
        return (ca.vertcat(-ahead[1], ahead[0], 0),)
    return tangents(ahead, ca.SX.zeros(3))
