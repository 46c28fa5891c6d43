"""The sampled loops of a task in the worlds that vary: what is unstable, and what rings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from taskspec.deferred_methods import dataclass
from taskspec.program.plan import TaskPlan
from taskspec.rules.stability import (
    Shared,
    describe,
    named,
    on_axis,
    resolved,
    ringing_of,
    worst_of,
    worst_worlds,
)
from taskspec.spec import LoadedTask
from taskspec.stability.corners import Corner
from taskspec.stability.loop import UnfitError
from taskspec.stability.margin import grows
from taskspec.stability.sampled_stage import SampledStage, control_of, loop_of


@dataclass(frozen=True, slots=True)
class LoopFault:
    """A loop that is not as it should be.

    Attributes:
        unstable: a mode grows; else one rings.
        text: of the stage, the world and the mode.
    """

    unstable: bool
    text: str


def loop_faults(plan: TaskPlan, loaded: LoadedTask) -> Iterator[LoopFault]:
    """The loops of a task that grow or ring, in the file's world or the worst of `vary`.

    Args:
        plan: of the task.
        loaded: the same task, perhaps with another `vary`.
    """
    shared = Shared(replace(plan.context, loaded=loaded))
    controls = set()
    for stage in plan.stages.values():
        control = control_of(stage)
        if control in controls or stage.joint_path is not None or stage.frame.tracking is not None:
            continue
        controls.add(control)
        try:
            analysed = loop_of(plan, stage.name)
            if analysed is not None and resolved(analysed, plan.context.loaded.task):
                yield from _of(analysed, shared)
        except (UnfitError, np.linalg.LinAlgError):
            continue


def _of(analysed: SampledStage, shared: Shared) -> Iterator[LoopFault]:
    here = analysed.free() if analysed.meets else analysed
    worst = worst_of(here.modes())
    if worst is not None and grows(worst):
        yield _fault(here, shared, None, unstable=True)
        return
    if analysed.meets:
        return
    found = worst_worlds(analysed, shared)
    if found.unstable is not None:
        yield _fault(analysed, shared, found.unstable[1], unstable=True)
    elif found.ringing is not None:
        yield _fault(analysed, shared, found.ringing[1], unstable=False)
    elif ringing_of(analysed.modes()) is not None:
        yield _fault(analysed, shared, None, unstable=False)


def _fault(
    analysed: SampledStage, shared: Shared, corner: Corner | None, *, unstable: bool
) -> LoopFault:
    modes = analysed.modes(None if corner is None else corner.task)
    mode = worst_of(modes) if unstable else ringing_of(modes)
    assert mode is not None
    where = "" if corner is None else f" at {named(shared.context.loaded.task, corner)}"
    predicted = describe(mode, shared.context.period)
    text = (
        f"stage {analysed.stage.name!r}{where}: {on_axis(analysed.axis(mode, modes))} {predicted}"
    )
    return LoopFault(unstable, text)
