"""Frames that follow the contact force or the motion, filtered, no faster than a limit.

With f the measured force by the environment, or the velocity of the tool's reference point, f_c
the filter's cutoff and F what the filter holds,

    dF/dt = 2 pi f_c (f - F),   d turns to F/|F| at no more than the frame's greatest rate W,

while |F| is above a floor; below it d stays. With w_F the rate of F/|F| and e the angle from d to
it, the rate of d goes towards w_F + 2 pi f_c e, which is cut to W, by at most 2 pi f_c W in a
second: d begins and ends to turn without a step of its rate, brakes in time to stop at F/|F|, and
then follows it without a lag of its own. A rate that stepped would step the torque by the damping
of the rotations times W. d is the frame's z where it tracks the force, and its x where it tracks
the velocity. The axes of a tick follow from the ticks before it.
A direction that turns at W is followed at a distance of atan(W / (2 pi f_c)): `lag`.
"""

from __future__ import annotations

import math

import casadi as ca

from taskspec.program.slots import Slots
from taskspec.program.world.estimated_frames import LEAST_SINE
from taskspec.program.world.frames import DirectionTracking, FrameModel

#: Slots of the memory: the filtered force [N] or velocity [m/s], the direction that follows it,
#: and its rate [1/s], world axes.
FILTERED, DIRECTION, RATE = "track.filtered", "track.direction", "track.rate"
#: Numbers of these together.
SIZE = 9
#: What a stage hands on of its frame: nothing, or the number of what that tracks.
NUMBERS = {"force": 1.0, "velocity": 2.0}
#: What keeps a direction of nothing from being none: far below the digits of a unit vector.
_NOTHING = 1e-24


def symbols(memory: Slots) -> ca.SX:
    """(9,) what the filter holds, the direction and its rate; takes slots of a stage's memory."""
    return ca.vertcat(*(memory.add(slot, 3) for slot in (FILTERED, DIRECTION, RATE)))


def begun(frame: FrameModel, tool: ca.SX) -> ca.SX:
    """(9,) before anything has been measured, with the tool's axes (3, 3).

    z is against the axis of the tool where the force is tracked, x along the heading where the
    velocity is.
    """
    tracking = _tracking(frame)
    first = -tool[:, 2] if tracking.of == "force" else ca.SX(ca.DM(tracking.begun))
    return ca.vertcat(ca.SX.zeros(3), first, ca.SX.zeros(3))


def axes(frame: FrameModel, direction: ca.SX) -> tuple[ca.SX, ca.SX]:
    """(3, 3) axes for the direction (3,) that is tracked; and how far they are defined.

    The axis across it is along that part of the frame's `across`; the second is positive while
    both are not the same.
    """
    tracking = _tracking(frame)
    given = ca.SX(ca.DM(tracking.across))
    across = given - direction * ca.dot(direction, given)
    size = ca.sqrt(ca.dot(across, across) + _NOTHING)
    across = across / size
    if tracking.of == "force":
        found = ca.horzcat(across, ca.cross(direction, across), direction)
    else:
        found = ca.horzcat(direction, ca.cross(across, direction), across)
    return found, size - LEAST_SINE


def tracked(frame: FrameModel, force: ca.SX, velocity: ca.SX) -> ca.SX:
    """(3,) what a frame tracks, of the force by the environment and the tool's velocity (3,)."""
    return force if _tracking(frame).of == "force" else velocity


def step(frame: FrameModel, state: ca.SX, now: ca.SX, period: float) -> ca.SX:
    """(9,) after a tick.

    Args:
        frame: whose filter, floor and greatest rate count.
        state: (9,) before it.
        now: (3,) what it tracks, world axes; see `tracked`.
        period: [s].
    """
    tracking = _tracking(frame)
    share = _share(tracking.filter, period)
    before, rate = state[3:6], state[6:]
    held = state[:3] + share * (now - state[:3])
    size, goal = _sized(held)
    former_size, former_goal = _sized(state[:3])
    pressed = size > tracking.floor
    # How far the goal has gone in this tick, and how far it is away.
    gone = _across(goal - former_goal, before) * (former_size > tracking.floor)
    sine, towards = _sized(_across(goal, before))
    away = ca.atan2(sine, ca.dot(before, goal)) * towards
    wanted = pressed * _cut((gone + share * (away - gone)) / period, tracking.turn)
    rate = _across(rate, before)
    rate += _cut(wanted - rate, tracking.turn * share)
    speed, along = _sized(rate)
    angle = speed * period
    _, turned = _sized(before * ca.cos(angle) + along * ca.sin(angle))
    following = ca.if_else(ca.dot(rate, rate) > 0, turned, before)
    return ca.vertcat(held, following, (following - before) / period)


def _sized(vector: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The length of a vector (3,), and its direction."""
    size = ca.sqrt(ca.dot(vector, vector) + _NOTHING)
    return size, vector / size


def _across(vector: ca.SX, direction: ca.SX) -> ca.SX:
    """The part of a vector (3,) across a direction (3,)."""
    return vector - direction * ca.dot(direction, vector)


def _cut(vector: ca.SX, most: float) -> ca.SX:
    """A vector (3,), shortened to a length of `most` where it is longer."""
    size, direction = _sized(vector)
    return ca.if_else(size > most, most * direction, vector)


def _share(cutoff: float, period: float) -> float:
    """The weight of a new value in the filter for a tick of `period` [s]: 1 - exp(-2 pi f_c T)."""
    return -math.expm1(-2 * math.pi * cutoff * period)


def passes(cutoff: float, period: float) -> float:
    """The gain of the filter at the fastest change, one from tick to tick.

    With z = -1 in s/(z - 1 + s), s = 1 - exp(-2 pi f_c T), that is s/(2 - s) = tanh(pi f_c T). Of a
    filter that is to have a cutoff it is less than 1/sqrt(2): f_c T < 0.281, see `fastest_filter`.
    """
    share = _share(cutoff, period)
    return share / (2 - share)


def fastest_filter(period: float) -> float:
    """The cutoff from which on no frequency is halved in power, in ticks of `period` [s] [Hz].

    f_c T = artanh(1/sqrt(2))/pi = 0.281: what is faster than half the control rate has no samples.
    """
    return math.atanh(math.sqrt(0.5)) / (math.pi * period)


def updates(frame: FrameModel, memory: Slots, now: ca.SX, period: float) -> dict[str, ca.SX]:
    """The slots of the memory after a tick; see `step`."""
    state = ca.vertcat(*(memory.symbol(slot) for slot in (FILTERED, DIRECTION, RATE)))
    after = step(frame, state, now, period)
    return {FILTERED: after[:3], DIRECTION: after[3:6], RATE: after[6:]}


def _tracking(frame: FrameModel) -> DirectionTracking:
    assert frame.tracking is not None
    return frame.tracking


def lag(rate: float, cutoff: float) -> float:
    """The lag of z [rad] behind a measured force that turns at `rate` [rad/s]; `cutoff` in Hz."""
    return math.atan2(rate, 2 * math.pi * cutoff)


def sliding_lag(rate: float, cutoff: float, friction: float) -> float | None:
    """The lag of a frame on a tool that slides along its x [rad].

    A tracked velocity is along the surface with friction or without: its lag is that of a force
    without friction.

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
