"""Jerk-limited moves, planned by Ruckig."""

from __future__ import annotations

import numpy as np
from ruckig import InputParameter, Result, Ruckig, RuckigError, Trajectory

from taskspec.motion.polynomial import PiecewiseCubic, constant, from_states

#: A move reaches its speed in this time [s], with a smooth rise of the acceleration.
RISE_TIME = 0.2
#: A length [m or rad] that is no more than what rounding leaves.
_NOWHERE = 1e-12
_NEVER_REACHED = 1.001
#: Where a distance fits the limits to the last bit, a speed lower by a billionth does not.
_NUDGES = (1.0, 1 - 1e-9, 1 - 1e-6)


def move(
    start: float, velocity: float, target: float, speed: float, rise: float = RISE_TIME
) -> PiecewiseCubic:
    """A time-optimal move under limits of speed, acceleration 2 speed/rise and jerk 4 speed/rise^2.

    Args:
        start, velocity: initial position and velocity [m, m/s] or [rad, rad/s].
        target: where it comes to rest.
        speed: limit, positive.
        rise: see `RISE_TIME` [s].

    Returns:
        Position against time [s] from the move's start; rests at `target` afterwards.

    Raises:
        ValueError: Ruckig finds no such move (non-finite numbers, zero speed).
    """
    if start == target and velocity == 0.0:
        return constant(target)
    planned = _plan(start, velocity, target, speed, rise)
    profile = planned.profiles[0][0]
    durations = np.array([*profile.brake.t, *profile.t])
    times = [0.0, *np.cumsum(durations[durations > 1e-9]).tolist()]
    states = []
    for time in times:
        p, v, a = planned.at_time(time)
        states.append((p[0], v[0], a[0]))
    return from_states(times, states)


def timing(length: float, *, speed: float | None, time: float | None) -> PiecewiseCubic:
    """The path parameter (0 to 1) against time [s], from rest to rest.

    Args:
        length: of the path [m or rad].
        speed: along it, or time: that it takes; one is given.
    """
    if length <= _NOWHERE:
        return from_states([0.0, time or 1e-3], [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
    if time is None:
        assert speed is not None
        return move(0.0, 0.0, 1.0, speed / length)
    rise = min(RISE_TIME, time / 2)
    return move(0.0, 0.0, 1.0, 1.0 / (time - rise), rise)


def _plan(start: float, velocity: float, target: float, speed: float, rise: float) -> Trajectory:
    limits = InputParameter(1)
    limits.current_position, limits.current_velocity = [start], [velocity]
    limits.current_acceleration, limits.target_position = [0.0], [target]
    # The rise peaks at twice the mean acceleration; a limit just above it is never reached and
    # spares Ruckig the degenerate profiles whose phases have no length.
    limits.max_acceleration = [2 * speed / rise * _NEVER_REACHED]
    limits.max_jerk = [4 * speed / rise**2]
    for slower in _NUDGES:
        limits.max_velocity = [speed * slower]
        planned = Trajectory(1)
        try:
            result = Ruckig(1).calculate(limits, planned)
        except RuckigError:
            continue
        if result in (Result.Working, Result.Finished):
            return planned
    raise ValueError(f"no move from {start} to {target} at {speed}")
