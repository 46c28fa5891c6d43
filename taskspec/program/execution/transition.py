"""How a stage ended, and where that led."""

from __future__ import annotations

from collections.abc import Sequence

from taskspec.deferred_methods import dataclass
from taskspec.program import events
from taskspec.program.events import Event
from taskspec.program.stages.stage import CompiledStage
from taskspec.spec import Stage

#: Where a transition leads when it leads to no stage.
END, FAIL = "end", "fail"


@dataclass(slots=True)
class Transition:
    """A stage that ended.

    Attributes:
        clock: [s] when.
        stage: that ended.
        kind, name, text: the event.
        value: its quantity.
        to: the next stage, `end` or `fail`; empty where a limit stopped the run.
        torque_step: how far the next stage's first torque is from this one's at the same
            measurement, of the joint where that is most [N m].
        torque_carried: how far this one's is from what the next law commands, and handed over [N
            m].
    """

    clock: float
    stage: str
    kind: str
    name: str
    text: str
    value: float
    to: str
    torque_step: float = 0.0
    torque_carried: float = 0.0

    @property
    def good(self) -> bool:
        """Whether the stage ended as planned."""
        return self.kind in (events.UNTIL, events.DONE)


@dataclass(frozen=True, slots=True)
class Exit:
    """Where an event of a stage leads.

    Attributes:
        event: that happens.
        to: name of the next stage, `end` or `fail`; empty where a limit stops the run.
        index: number of the next stage; None where there is none.
        repeat: how often the stage is to end by it in a row before it leads there.
    """

    event: Event
    to: str
    index: int | None
    repeat: int = 1


def exits(stages: Sequence[CompiledStage]) -> tuple[tuple[Exit, ...], ...]:
    """Where each event of each stage leads, in the order of their numbers."""
    names = [stage.name for stage in stages]

    def leads(stage: CompiledStage, event: Event, following: str) -> Exit:
        to = leads_to(stage.plan.spec, event, following)
        index = None if to in (END, FAIL, "") else names.index(to)
        repeat = stage.plan.spec.repeat if is_good(event) else 1
        return Exit(event, to, index, repeat)

    return tuple(
        tuple(leads(stage, event, following) for event in stage.events)
        for stage, following in zip(stages, [*names[1:], END], strict=True)
    )


def leads_to(stage: Stage, event: Event, following: str) -> str:
    """The stage to which an event leads, `end` or `fail`; empty where a limit stops the run.

    Args:
        stage: in which it happened.
        event: what happened.
        following: the next stage of the file, `end` after the last one.
    """
    if event.is_limit:
        return event.then
    if is_good(event):
        return stage.ways(following)[event.way]
    return stage.on_fail or FAIL


def is_good(event: Event) -> bool:
    """Whether a stage ends as planned by it."""
    return event.kind in (events.UNTIL, events.DONE)
