"""Stages whose sampled closed loop is predicted to be unstable, or to ring."""

from __future__ import annotations

import numpy as np

from taskspec.analysis.budget import Budget
from taskspec.analysis.loop import UnfitError
from taskspec.analysis.margin import grows
from taskspec.analysis.stage import Analysed, analyse
from taskspec.check.stability.reporting import report
from taskspec.check.stability.worlds import (
    Plants,
    Shared,
    check_worlds,
    resolved,
    ringing_of,
    worst_of,
)
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.spec import AxisEntry
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, Severity

register(
    {
        "TS501": "a stage that is predicted to be unstable",
        "TS502": "a stage that is predicted to ring",
        "TS505": "a contact in which a motion would be unstable",
        "TS506": "a stage that is unstable while friction holds the tool",
    }
)

#: So many gains are searched for what mends the stages of a file: a third of a second's work.
_MOST_SEARCHED = 12
#: So many worlds of a file are looked at all at once, a third of a second's work; beyond that one
#: value varies at a time.
_MOST_WORLDS = 400


def check_stability(task: TaskPlan, found: Diagnostics) -> None:
    """Reports stages that are predicted to be unstable or to ring, each way of control once."""
    seen: set[str] = set()
    shared = Shared(Plants(), Budget(_MOST_SEARCHED), Budget(_MOST_WORLDS))
    for stage in task.stages.values():
        key = _control(stage)
        if key in seen:
            continue
        seen.add(key)
        try:
            _check_stage(stage, shared, found)
        except (UnfitError, np.linalg.LinAlgError):
            continue


def _control(stage: StagePlan) -> str:
    """What the stability of a stage depends on: stages that have it in common need one look."""
    axes = {
        name: _kind(axis)
        for name, axis in stage.spec.axes.items()
        if _kind(axis) != _kind(AxisEntry())
    }
    law = stage.law.model_dump_json()
    return repr((sorted(axes.items()), stage.frame.name, law, sorted(stage.spec.constraints)))


def _kind(axis: AxisEntry) -> tuple[object, ...]:
    return (
        axis.has_force,
        axis.mode.loop,
        axis.stiffness,
        axis.damping,
    )


def _check_stage(stage: StagePlan, shared: Shared, found: Diagnostics) -> None:
    context, name = stage.context, stage.name
    seen = analyse(stage)
    if seen is None or not resolved(seen, context.loaded.task):
        return
    if seen.meets:
        free = seen.free()
        if not _check_nominal(context, free, shared, found):
            return
        worst = worst_of(seen.modes())
        if worst is not None and grows(worst):
            report(
                context, seen, worst, found, shared.gains, "TS505", Severity.WARNING,
                f"stage {name!r} would be unstable in contact with {next(iter(seen.pressed))!r}",
            )  # fmt: skip
        return
    if _check_nominal(context, seen, shared, found):
        check_worlds(context, seen, shared, found)
        _check_sticking(context, seen, shared, found)


def _check_nominal(context: Context, seen: Analysed, shared: Shared, found: Diagnostics) -> bool:
    """Whether the stage is stable in the world of the file; reports where it is not, or rings."""
    modes = seen.modes()
    worst = worst_of(modes)
    if worst is None:
        return True
    if grows(worst):
        text = f"stage {seen.stage.name!r} is unstable"
        report(context, seen, worst, found, shared.gains, "TS501", Severity.ERROR, text)
        return False
    ringing = ringing_of(modes)
    if ringing is not None:
        text = f"stage {seen.stage.name!r} rings"
        report(context, seen, ringing, found, shared.gains, "TS502", Severity.WARNING, text)
        return False
    return True


def _check_sticking(context: Context, seen: Analysed, shared: Shared, found: Diagnostics) -> None:
    """Reports a stage that is stable while the tool slides, but not while friction holds it."""
    stuck = seen.stuck()
    worst = None if stuck is None else worst_of(stuck.modes())
    if stuck is not None and worst is not None and grows(worst):
        text = f"stage {seen.stage.name!r} is unstable while friction holds the tool"
        report(context, stuck, worst, found, shared.gains, "TS506", Severity.WARNING, text)
