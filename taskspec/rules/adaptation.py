"""Adaptation to a payload: one for all stages, that something shows, not too fast for the loop."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.execution.payload_estimate import adaptation
from taskspec.program.plan import TaskPlan
from taskspec.program.sensor import SensorModel
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.rules.places import adaptation_of
from taskspec.spec import FILE
from taskspec.text.units import FREQUENCY, scaled

#: Parts of a bandwidth up to which one that is slow enough is searched.
_PARTS = 200


@rule({}, also=("TS138",), phase=Phase.RUN)
def one_adaptation(task: TaskPlan) -> Iterator[Finding]:
    """Laws that adapt with other numbers than the first: the payload is one."""
    first = task.context.loaded.task.adapt
    for stage in task.framed.values():
        own = stage.spec.law
        if own is not None and own.adapt is not None and own.adapt != first:
            yield error(
                "TS138",
                f"stage {stage.name!r} adapts otherwise than stages before it, and the estimate "
                "is one for all",
                FILE.stages[stage.name].law.adapt,
                "give each the same 'adapt', or leave it out where nothing is to adapt",
            )


@rule("TS345", "an adaptation that no stage can make", phase=Phase.RUN)
def never_adapting(task: TaskPlan) -> Iterator[Finding]:
    """A sensor at the wrist, and no stage in which all that it reads is the payload."""
    having = [stage for stage in task.framed.values() if stage.adapt is not None]
    if having and not any(stage.adapts for stage in having):
        names = ", ".join(repr(stage.name) for stage in having)
        yield error(
            "TS345",
            f"a sensor at the wrist reads payload and contact as one force, and stage {names} is "
            "about a contact: nothing adapts",
            adaptation_of(having[0]),
            "let a stage before adapt that touches nothing, in the frame 'world' and without a "
            "force; others go by its estimate",
        )


@rule("TS513", "an adaptation too fast for the sampled loop", phase=Phase.STABILITY)
def too_fast(task: TaskPlan) -> Iterator[Finding]:
    """Estimates that grow from tick to tick, by the delay of the contact force (`growth`)."""
    declared, period = task.context.loaded.task, task.context.period
    adapted = adaptation(declared, period)
    stage = next((each for each in task.framed.values() if each.adapts), None)
    if adapted is None or stage is None or declared.adapt is None:
        return
    model = SensorModel.of(declared.robot.sensor, period)
    # Of a wrist's sensor nothing goes into the estimate.
    late = declared.robot.sensor.at == "contact"
    delay = model.delay_ticks + model.hold_ticks // 2 if late else 0
    pole = model.pole if late else 0.0

    def grows(w: float) -> bool:
        return adapted.but(w).growth(delay, pole) >= 1.0

    if not grows(adapted.w):
        return
    parts = (adapted.w * (1 - part / _PARTS) for part in range(1, _PARTS))
    slow = next((w for w in parts if not grows(w)), 0.0)
    bandwidth = declared.adapt.to.bandwidth
    lag = model.lag(period) if late else period
    yield warning(
        "TS513",
        f"an estimate of {scaled(bandwidth, FREQUENCY, 3)} grows from tick to tick on a stiff "
        f"contact, whose force the controller gets {1e3 * lag:.3g} ms late",
        adaptation_of(stage),
        f"adapt with {scaled(slow / adapted.w * bandwidth, FREQUENCY, 2)} at most, half of that "
        "to settle soon"
        if slow
        else "adapt more slowly",
    )
