"""The force sensor: what its rate and delay become, and stages that tare it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from taskspec.laws.design import INTEGRAL_FREQUENCY
from taskspec.program.context import Context
from taskspec.program.flow import leading_to
from taskspec.program.plan import TaskPlan
from taskspec.program.sensor import SensorModel
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.signals.entries import TOUCHING
from taskspec.spec import FILE
from taskspec.text.units import TIME, scaled, show


@rule("TS431", "a sensor's rate that does not divide the controller's", phase=Phase.TASK)
def uneven_rate(task: TaskPlan) -> Iterator[Finding]:
    """A rate that becomes another, because samples come in ticks of the controller."""
    period, sensor = task.context.period, task.context.loaded.task.robot.sensor
    model = SensorModel.of(sensor, period)
    if sensor.rate is None or model.hold_ticks <= 1:
        return
    becomes = 1.0 / (model.hold_ticks * period)
    if not math.isclose(becomes, sensor.rate, rel_tol=1e-6):
        yield warning(
            "TS431",
            f"samples come at {show(becomes, 'Hz', 4)}: {show(sensor.rate, 'Hz', 4)} does not "
            f"divide the controller's {show(1 / period, 'Hz', 4)}",
            FILE.robot.sensor.rate,
            "choose a rate that divides that of the controller",
        )


@rule("TS430", "a force sensor too slow for a force loop", phase=Phase.TASK)
def late_sensor(task: TaskPlan) -> Iterator[Finding]:
    """A sensor whose force the controller gets later than a designed loop is made for.

    That of an arm that takes velocities is designed for whatever delay there is.
    """
    period, declared = task.context.period, task.context.loaded.task
    if not declared.robot.takes_torques:
        return
    lag = SensorModel.of(declared.robot.sensor, period).lag(period)
    slowest = 1.0 / (2 * math.pi * INTEGRAL_FREQUENCY)
    uses = any(a.has_force for s in declared.stages.values() for a in s.axes.values())
    if lag > slowest and uses:
        late = scaled(lag, TIME, 3)
        yield warning(
            "TS430",
            f"the controller sees a force {late} late, by delay, sampling and filter; a designed "
            f"force loop answers within {show(slowest, 'ms', 2)} and is not made for that",
            FILE.robot.sensor,
            "shorten the delay, raise rate or filter, or give the law a lower force.integral",
        )


@rule("TS620", "a tare while a force acts", phase=Phase.TASK)
def misleading_tares(task: TaskPlan) -> Iterator[Finding]:
    """Stages that tare the sensor while a force acts on it."""
    stages = task.context.loaded.task.stages
    for number, (name, stage) in enumerate(stages.items()):
        if not stage.tare:
            continue
        pressed = [a for a, axis in stage.axes.items() if axis.has_force]
        if pressed:
            yield error(
                "TS620",
                f"the force on {pressed[0]!r} would become the sensor's zero",
                FILE.stages[name].axes[pressed[0]],
                "tare in a stage of its own, that holds its axes away from everything",
            )
            continue
        previous = next(iter(leading_to(stages, name)), None)
        if number == 0 and _force_at_start(task.context) > TOUCHING:
            why = "the tool touches at the start"
        elif previous is not None and stages[previous].ends_in_contact:
            why = f"stage {previous!r} before it ends in contact"
        else:
            continue
        yield warning(
            "TS620",
            f"{why}: the contact force would become the sensor's zero",
            FILE.stages[name].tare,
            "move away from the surface first",
        )


def _force_at_start(context: Context) -> float:
    """The largest contact force with an object where the run begins [N]."""
    gaps = context.touchable_gaps
    return max((-gap * context.compliances[o].stiffness for o, gap in gaps.items()), default=0.0)
