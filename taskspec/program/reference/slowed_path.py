"""A path that is slowed by signals: it goes by a time of its own, whose rate they decide.

The path is planned for the greatest speed V that its expression v can have. With t' the path's time
and w = v/V, between 0 and 1,

    dt'/dt = u,   du/dt = clamp((w - u)/T_u, -1/T, 1/T),

T the rise time of a move and T_u a quarter of that. So it never goes back, what the plan allows at
V bounds it, and the share u changes no faster than from 0 to 1 in T.
"""

from __future__ import annotations

import casadi as ca

from taskspec.motion.path import PathShape
from taskspec.motion.profile import RISE_TIME
from taskspec.program.reference.measurement import Measurement

#: Of the share's lag [s]: noise of a sensor does not become acceleration.
LAG = RISE_TIME / 4
#: Slots of the memory: the path's time [s], its rate, and the stage time of both [s].
TIME, SHARE, AT = "path.time", "path.share", "path.at"
INITIAL = {TIME: 0.0, SHARE: 1.0, AT: 0.0}


def path_time(path: PathShape, measurement: Measurement) -> tuple[ca.SX, dict[str, ca.SX]]:
    """The time by which a path goes [s], and what is memorised of it.

    Args:
        path: whose it is.
        measurement: of its stage.
    """
    t, period = measurement.clock.t, measurement.algebra.period
    if path.slowed is None:
        return t, {}
    passed, share, at = (measurement.memory.add(slot) for slot in (TIME, SHARE, AT))
    assert path.speed is not None
    wanted = ca.fmin(ca.fmax(measurement.translate(path.slowed) / path.speed, 0), 1)
    rate = ca.fmin(ca.fmax((wanted - share) / LAG, -1 / RISE_TIME), 1 / RISE_TIME)
    # Both times are those of this tick: the difference makes it an expression of time.
    since = t - at
    time = passed + since * (share + since * rate / 2)
    after = passed + period * (share + period * rate / 2)
    return time, {TIME: after, SHARE: share + period * rate, AT: t + period}
