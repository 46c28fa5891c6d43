"""The rate of the path's time where signals slow it, as far as the file determines it.

The rate u of the path's time is that of `slowed_path`: the speed that the signals command, as a
share of the greatest that the path is planned for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from taskspec.expression import Expression, FloatAlgebra, evaluate
from taskspec.expression.tree import Name
from taskspec.motion.path import PathShape
from taskspec.program.context import Context
from taskspec.program.interval import ANY, Interval, IntervalAlgebra
from taskspec.program.known_value import KnownValues
from taskspec.program.signals import constant, declared, entry_of
from taskspec.spec import Stage

#: A time at which what rises with t has risen [s].
_SETTLED_TIME = 60.0


def values_within(
    context: Context, stage: Stage, expression: Expression, longest: float = math.inf
) -> Interval:
    """The range of an expression by its signals' nature and the stage's limits.

    Args:
        context: of the task.
        stage: that it stands in.
        expression: of measured signals.
        longest: after which the stage has ended whatever happens [s].
    """
    task = context.loaded.task
    limits = task.limits_of(stage).stopping()

    def bounds(name: Name) -> Interval:
        found = entry_of(task, name.path)
        if found is None:
            return constant(context, name) or ANY
        signal = found.signal
        natural = Interval(signal.low, longest if signal.name == "t" else signal.high)
        most = getattr(limits, signal.limit) if signal.limit else None
        return natural if most is None else natural.meet(Interval(-most, most))

    return evaluate(expression.tree, IntervalAlgebra(), bounds)


def least_share(context: Context, stage: Stage, path: PathShape | None) -> float:
    """The lower bound of the rate of the path's time: 1 for a path that nothing slows."""
    if path is None or path.slowed is None:
        return 1.0
    assert path.speed is not None
    least = values_within(context, stage, path.slowed).low
    return max(least / path.speed, 0.0)


def nominal_share(
    context: Context, stage: Stage, path: PathShape | None, known: KnownValues
) -> float:
    """The rate of the path's time at nominal signals: its set points are measured, all else is 0.

    1 for a path that nothing slows.
    """
    if path is None or path.slowed is None:
        return 1.0
    assert path.speed is not None
    forces = _nominal_forces(stage, known)

    def nominal(name: Name) -> float:
        worth = declared(context, name)
        return forces.get(str(name).partition(" ")[0], 0.0) if worth is None else worth

    value = evaluate(path.slowed.tree, FloatAlgebra(), nominal) / path.speed
    return min(max(value, 0.0), 1.0) if math.isfinite(value) else 0.0


def _nominal_forces(stage: Stage, known: KnownValues) -> Mapping[str, float]:
    """Nominal signals at the stage's set points."""
    found = {"t": _SETTLED_TIME, "clock": _SETTLED_TIME}
    for axis, entry in stage.axes.items():
        force = entry.set_point
        value = (
            None
            if force is None
            else known(force.wanted, {"t": _SETTLED_TIME, "clock": _SETTLED_TIME})
        )
        if value is not None:
            found[f"{axis.effort}.{axis}"] = value
    if any(found.get(f"force.{a}") for a in "xyz"):
        found["touching"] = 1.0
    return found
