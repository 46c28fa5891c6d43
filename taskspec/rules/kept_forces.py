"""Holds that keep a force: a stage before has to have one."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.kept_forces import before
from taskspec.program.plan import StagePlan
from taskspec.rules.finding import Finding, error
from taskspec.rules.registry import Phase, rule
from taskspec.spec import FILE


@rule("TS238", "a hold of a force that the stage before does not have", phase=Phase.AXES)
def missing_kept_forces(stage: StagePlan) -> Iterator[Finding]:
    """Axes with `hold: force` after a stage without a force there, in another frame, or first."""
    task = stage.context.loaded.task
    kept = [
        axis for axis, each in stage.spec.axes.items() if each.set_point and each.set_point.kept
    ]
    earlier = before(task, stage.name) if kept else []
    for axis in kept:
        place = FILE.stages[stage.name].axes[axis].hold
        effort = "moment" if axis.is_rotation else "force"
        hint = f"give {axis!r} a {axis.effort} of its own"
        if not earlier or stage.name == next(iter(task.stages)):
            yield error("TS238", f"no stage before this one has a {effort} to keep", place, hint)
        for each in earlier:
            own = task.stages[each].axes.get(axis)
            if own is None or not own.has_force:
                message = f"stage {each!r}, which leads here, has no {effort} on {axis!r} to keep"
                yield error("TS238", message, place, hint)
            elif (task.stages[each].frame or task.frame) != stage.frame.name:
                message = f"stage {each!r}, which leads here, has its {effort} in another frame"
                yield error("TS238", message, place, "keep the frame, or " + hint)
