"""Frames that follow the contact force: z against it, filtered, turning no faster than a limit.

With f the measured force by the environment, f_c the filter's cutoff and F what the filter holds,

    dF/dt = 2 pi f_c (f - F),   z turns to F/|F| at no more than the frame's greatest rate,

while |F| is above a floor; below it z stays. The axes of a tick follow from the ticks before it.
A normal that turns at W is followed at a distance of atan(W / (2 pi f_c)): `lag`.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from taskspec.program.slots import Slots
from taskspec.program.world.estimated_frames import LEAST_SINE
from taskspec.program.world.frames import FrameModel

#: Slots of the memory: the filtered force [N], z, and its rate [1/s], world axes.
FORCE, NORMAL, RATE = "track.force", "track.normal", "track.rate"
#: Numbers of these together.
SIZE = 9
#: What keeps a direction of nothing from being none: far below the digits of a unit vector.
_NOTHING = 1e-24


def symbols(memory: Slots) -> ca.SX:
    """(9,) filtered force, z and its rate; takes the slots of a stage's memory."""
    return ca.vertcat(*(memory.add(slot, 3) for slot in (FORCE, NORMAL, RATE)))


def begun(tool: ca.SX) -> ca.SX:
    """(9,) as nothing has been felt yet: z against the axis of a tool with axes (3, 3)."""
    return ca.vertcat(ca.SX.zeros(3), -tool[:, 2], ca.SX.zeros(3))


def axes(frame: FrameModel, normal: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(3, 3) axes for a z (3,): x along the heading's part across it; and how far that is defined.

    The second is positive while the heading is not along z.
    """
    heading = np.array([1.0, 0.0, 0.0]) if frame.heading is None else frame.heading
    along = ca.SX(ca.DM(heading / np.linalg.norm(heading)))
    across = along - normal * ca.dot(normal, along)
    size = ca.sqrt(ca.dot(across, across) + _NOTHING)
    x = across / size
    return ca.horzcat(x, ca.cross(normal, x), normal), size - LEAST_SINE


def step(frame: FrameModel, state: ca.SX, force: ca.SX, period: float) -> ca.SX:
    """(9,) after a tick.

    Args:
        frame: whose filter, floor and greatest rate count.
        state: (9,) before it.
        force: (3,) measured, by the environment, world axes [N].
        period: [s].
    """
    tracking = frame.tracking
    assert tracking is not None
    share = -math.expm1(-2 * math.pi * tracking.filter * period)
    felt, normal = state[:3], state[3:6]
    felt = felt + share * (force - felt)
    size = ca.sqrt(ca.dot(felt, felt) + _NOTHING)
    goal = felt / size
    across = goal - normal * ca.dot(normal, goal)
    sine = ca.sqrt(ca.dot(across, across) + _NOTHING)
    angle = ca.fmin(ca.atan2(sine, ca.dot(normal, goal)), tracking.turn * period)
    turned = normal * ca.cos(angle) + across * (ca.sin(angle) / sine)
    turned = turned / ca.sqrt(ca.dot(turned, turned))
    following = ca.if_else(size > tracking.floor, turned, normal)
    return ca.vertcat(felt, following, (following - normal) / period)


def updates(frame: FrameModel, memory: Slots, force: ca.SX, period: float) -> dict[str, ca.SX]:
    """The slots of the memory after a tick; see `step`."""
    state = ca.vertcat(*(memory.symbol(slot) for slot in (FORCE, NORMAL, RATE)))
    after = step(frame, state, force, period)
    return {FORCE: after[:3], NORMAL: after[3:6], RATE: after[6:]}


def lag(rate: float, cutoff: float) -> float:
    """How far z is behind a felt force that turns at `rate` [rad/s], with a `cutoff` [Hz] [rad]."""
    return math.atan2(rate, 2 * math.pi * cutoff)


def sliding_lag(rate: float, cutoff: float, friction: float) -> float | None:
    """How far z is behind the felt force of a tool that slides along the frame's x [rad].

    Friction m tilts that force by phi = atan m against the motion, and z leans by d + phi. The
    tool keeps to the surface, so a speed v along x is v/cos(d + phi) on it, and its normal turns
    by that much faster than `rate`, the curvature times v:

        tan d cos(d + phi) = rate / (2 pi f_c).

    None where there is no such lag, or none that is stable: with F's length as the second state,
    the linear loop has the trace tan d tan(d + phi) - 2 and the determinant 1 + tan^2 d -
    tan d tan(d + phi), over 2 pi f_c. Without friction sin d = rate / (2 pi f_c), stable while
    tan d < sqrt(2): below sqrt(2/3) of the filter's own rate.

    Args:
        rate: at which the normal turns when z is along it [rad/s].
        cutoff: of the filter [Hz].
        friction: coefficient.
    """
    wanted, tilt = rate / (2 * math.pi * cutoff), math.atan(friction)
    most = stable_lag(friction)
    if math.tan(most) * math.cos(most + tilt) <= wanted:
        return None
    low, high = 0.0, most
    # tan d cos(d + phi) rises as far as the loop is stable.
    for _ in range(60):
        middle = (low + high) / 2
        below = math.tan(middle) * math.cos(middle + tilt) < wanted
        low, high = (middle, high) if below else (low, middle)
    return (low + high) / 2


def stable_lag(friction: float) -> float:
    """The lag at which the loop of `sliding_lag` ceases to be stable [rad]."""
    tilt = math.atan(friction)
    low, high = 0.0, math.pi / 2 - tilt
    for _ in range(60):
        d = (low + high) / 2
        both = math.tan(d) * math.tan(d + tilt)
        stable = both < 2 and both < 1 + math.tan(d) ** 2
        low, high = (d, high) if stable else (low, d)
    return low


def fastest_turn(cutoff: float, friction: float) -> float:
    """The greatest rate of turn at which `sliding_lag` is stable [rad/s]."""
    d = stable_lag(friction)
    return 2 * math.pi * cutoff * math.tan(d) * math.cos(d + math.atan(friction))
