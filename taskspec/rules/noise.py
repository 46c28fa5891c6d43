"""Guards against the noise and the bias of the sensor that they look at."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from taskspec.foresight.conditions import bounds_of, names
from taskspec.foresight.ranges import Ranges
from taskspec.geometry.axis import Axis
from taskspec.program.context import Context
from taskspec.program.interval import Interval, IntervalAlgebra
from taskspec.program.plan import StagePlan
from taskspec.program.sensor import SensorModel
from taskspec.program.walk.nominal import AT_SURFACE
from taskspec.rules import Finding, rule, warning
from taskspec.text.expression import Expression
from taskspec.text.expression.tree import Binary, Call, Held, Name, Node, Number
from taskspec.text.units import FORCE, number, show

#: How probable it may be that noise alone ends a stage, or has to be that it lets it end.
_SELDOM = 0.01
#: For how long a stage is taken to last that nothing bounds in time [s].
_LONG = 10.0


@rule("TS614", "a guard finer than the sensor's noise")
def noisy_guards(stage: StagePlan) -> Iterator[Finding]:
    """Guards that noise or bias makes hold, or keeps from holding."""
    sensor = stage.context.loaded.task.robot.sensor
    if sensor.noise is None and not any(sensor.bias):
        return
    for guard in (stage.spec.until, stage.spec.fail_if):
        finding = None if guard is None else _finding(stage, guard)
        if finding is not None:
            yield finding


def _finding(stage: StagePlan, guard: Expression) -> Finding | None:
    """What the first quantity of a guard that noise or bias decides about gives rise to."""
    context, gap = stage.context, stage.nominal.gap
    inner = guard.tree.x if isinstance(guard.tree, Held) else guard.tree
    bounds = bounds_of([inner], IntervalAlgebra(), Ranges(stage))
    for quantity, interval in bounds.items():
        signal = _signal(quantity)
        if signal is None:
            continue
        spread, ticks = _spread(context, signal), _ticks(context, guard)
        apart = gap is None or gap > AT_SURFACE
        if _holds_by_itself(stage, quantity, interval, ticks) and apart:
            biased = any(context.loaded.task.robot.sensor.bias)
            what = f"noise of {_shown(signal, spread)}" if spread else "the sensor's bias"
            return warning(
                "TS614",
                f"{what}{' and the bias' if spread and biased else ''} can make this hold with "
                "nothing touched",
                guard.where(quantity),
                "ask for more, for a longer time with 'for', or tare the sensor first",
            )
        if spread and interval.high - interval.low < math.inf and ticks > 1:
            within = math.erf((interval.high - interval.low) / 2 / spread / math.sqrt(2))
            if within**ticks < _SELDOM:
                return warning(
                    "TS614",
                    f"noise of {_shown(signal, spread)} leaves this band in "
                    f"{number(100 * (1 - within), 2)} % of the readings, so it hardly holds "
                    f"for {ticks} of them",
                    guard.where(quantity),
                    "widen it, ask for a shorter time, or give the sensor a filter",
                )
    return None


def _signal(quantity: Node) -> Name | None:
    """The force or moment that a quantity is, up to its size or a constant; None of any other."""
    if isinstance(quantity, Call) and quantity.function in ("abs", "norm"):
        parts = quantity.args
    elif isinstance(quantity, Binary) and quantity.op in ("+", "-"):
        parts = (quantity.left, quantity.right)
    else:
        parts = (quantity,)
    if not all(isinstance(part, Name | Number) for part in parts):
        return None
    measured = [p for p in parts if isinstance(p, Name) and p.path[0] in ("force", "torque")]
    return measured[0] if measured else None


def _spread(context: Context, signal: Name) -> float:
    """Standard deviation of a measured force [N, N m].

    A low-pass of pole b leaves (1 - b)/(1 + b) of the variance of white noise.
    """
    sensor = context.loaded.task.robot.sensor
    if sensor.noise is None:
        return 0.0
    own = sensor.noise.force if signal.path[0] == "force" else sensor.noise.torque
    b = SensorModel.of(sensor, context.period).pole
    return own * math.sqrt((1 - b) / (1 + b))


def _ticks(context: Context, guard: Expression) -> int:
    """How many independent readings a guard asks for: held or filtered ones are the same."""
    time = guard.tree.amount.value_si if isinstance(guard.tree, Held) else 0.0
    model = SensorModel.of(context.loaded.task.robot.sensor, context.period)
    return 1 + int(time / context.period * (1 - model.pole) / model.hold_ticks)


def _holds_by_itself(stage: StagePlan, quantity: Node, interval: Interval, ticks: int) -> bool:
    """Whether noise and bias alone make a quantity what a guard waits for, with nothing touched."""
    signal = _signal(quantity)
    if signal is None or isinstance(quantity, Binary) or interval.low <= 0.0 <= interval.high:
        return False
    level = min(abs(interval.low), abs(interval.high))
    spread, offset = _spread(stage.context, signal), _bias(stage, signal)
    if isinstance(quantity, Name):
        level -= offset if interval.low > 0 else -offset
    else:
        level -= abs(offset)
    if level <= 0 or not spread:
        return level <= 0
    sides = 1 if isinstance(quantity, Name) else 2 * len(list(names(quantity)))
    alone = min(1.0, sides * 0.5 * math.erfc(level / spread / math.sqrt(2)))
    tries = min(stage.longest, _LONG) / stage.context.period
    return tries * alone**ticks > _SELDOM


def _bias(stage: StagePlan, signal: Name) -> float:
    """What the sensor shows along an axis at the start where there is nothing [N, N m]."""
    task = stage.context.loaded.task
    if any(each.tare for each in task.stages.values()) or signal.frame is not None:
        return 0.0
    half = slice(0, 3) if signal.path[0] == "force" else slice(3, 6)
    bias = np.array(task.robot.sensor.bias[half])
    shown = stage.rotation.T @ stage.context.start_R @ bias
    return float(shown[Axis(signal.path[1]).column])


def _shown(signal: Name, spread: float) -> str:
    return show(spread, FORCE.on(rotation=signal.path[0] == "torque"), 2)
