"""Places in a file that findings of several rules refer to."""

from __future__ import annotations

from taskspec.program.plan import StagePlan
from taskspec.program.walk.course import moving_axes
from taskspec.spec import FILE, KeyPath, key_of


def motion_of(stage: StagePlan) -> KeyPath:
    """Where a stage says how it moves."""
    own = FILE.stages[stage.name]
    if stage.spec.path is not None:
        return key_of(own.path)
    axis = next(iter(moving_axes(stage.spec)), None)
    return key_of(own.axes[axis] if axis else own)


def adaptation_of(stage: StagePlan) -> KeyPath:
    """Where the adaptation of a stage's law is given."""
    return FILE.law.adapt if stage.spec.law is None else FILE.stages[stage.name].law.adapt
