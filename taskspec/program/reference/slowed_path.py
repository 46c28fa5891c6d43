"""A path that is slowed by signals: it goes by a time of its own, whose rate they decide.

The path is planned for the greatest speed V that its expression v can have. With t' the path's time
and w = v/V, between 0 and 1,

    dt'/dt = u,   du/dt = clamp((w - u)/T_u, -1/T, 1/T),

T the rise time of a move and T_u a quarter of that. So it never goes back, what the plan allows at
V bounds it, and the share u changes no faster than from 0 to 1 in T.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import casadi as ca

from taskspec.motion.profile import RISE_TIME
from taskspec.program.context import Context
from taskspec.program.interval import ANY, Interval, IntervalAlgebra, point
from taskspec.program.signals import entry_of
from taskspec.spec import Stage
from taskspec.text.expression import Expression, FloatAlgebra, evaluate
from taskspec.text.expression.tree import Name

if TYPE_CHECKING:
    from taskspec.motion.path import PathShape
    from taskspec.program.plan import StagePlan
    from taskspec.program.reference.measurement import Measurement

#: Of the share's lag [s]: noise of a sensor does not become acceleration.
LAG = RISE_TIME / 4
#: Slots of the memory: the path's time [s], its rate, and the stage time of both [s].
TIME, SHARE, AT = "path.time", "path.share", "path.at"
INITIAL = {TIME: 0.0, SHARE: 1.0, AT: 0.0}
#: A time at which what rises with t has risen [s].
_LATE = 60.0


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


def speeds(context: Context, stage: Stage, speed: Expression) -> Interval:
    """What an expression can be, as far as its signals' nature and the stage's limits bound it."""
    task = context.loaded.task
    limits = task.limits_of(stage).stopping()

    def bounds(name: Name) -> Interval:
        found = entry_of(task, name.path)
        if found is None:
            known = _constant(context, name)
            return ANY if known is None else point(known)
        signal = found.signal
        natural = Interval(signal.low, signal.high)
        most = getattr(limits, signal.limit) if signal.limit else None
        return natural if most is None else natural.meet(Interval(-most, most))

    return evaluate(speed.tree, IntervalAlgebra(), bounds)


def least_share(stage: StagePlan) -> float:
    """What the rate of the path's time never falls below: 1 for a path that nothing slows."""
    path = stage.path
    if path is None or path.slowed is None:
        return 1.0
    assert path.speed is not None
    least = speeds(stage.context, stage.spec, path.slowed).low
    return max(least / path.speed, 0.0)


def nominal_share(stage: StagePlan) -> float:
    """The rate of the path's time at nominal signals: its set points are felt, all else is 0.

    1 for a path that nothing slows.
    """
    path = stage.path
    if path is None or path.slowed is None:
        return 1.0
    assert path.speed is not None
    felt = _felt(stage)

    def nominal(name: Name) -> float:
        known = _constant(stage.context, name)
        return felt.get(str(name).partition(" ")[0], 0.0) if known is None else known

    value = evaluate(path.slowed.tree, FloatAlgebra(), nominal) / path.speed
    return min(max(value, 0.0), 1.0) if math.isfinite(value) else 0.0


def _felt(stage: StagePlan) -> Mapping[str, float]:
    """What the stage's set points make of signals."""
    found = {"t": _LATE, "clock": _LATE}
    for axis, entry in stage.spec.axes.items():
        force = entry.set_point
        value = None if force is None else stage.known(force.wanted, {"t": _LATE, "clock": _LATE})
        if value is not None:
            found[f"{axis.effort}.{axis}"] = value
    if any(found.get(f"force.{a}") for a in "xyz"):
        found["touching"] = 1.0
    return found


def _constant(context: Context, name: Name) -> float | None:
    text, params = str(name), context.loaded.task.params
    if text == "pi":
        return math.pi
    return params[text].value if text in params else None
