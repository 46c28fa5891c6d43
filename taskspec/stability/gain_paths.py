"""Where the gains of a stage stand in the file, and which of them are one number there."""

from __future__ import annotations

from taskspec.geometry.axis import as_axis
from taskspec.program.context import Context
from taskspec.spec import FILE, KeyPath, below
from taskspec.stability.sampled_stage import SampledStage


def law_path(context: Context, stage: str) -> KeyPath:
    """Where the file has the law that stage `stage` follows."""
    own = context.loaded.task.stages[stage].law is not None
    return FILE.stages[stage].law if own else FILE.law


def gain_path(context: Context, stage: str, what: str, on: str) -> KeyPath:
    """Where the file has a gain on an axis, a joint or an equation.

    Args:
        context: the task.
        stage: its name.
        what: the gain.
        on: what it is of.
    """
    axis = as_axis(on)
    entry = None if axis is None else context.loaded.task.stages[stage].axes.get(axis)
    if entry is not None and getattr(entry, what, None) is not None:
        return FILE.stages[stage].axes[on][what]
    law = law_path(context, stage)
    if what == "joint_damping":
        return law.damping
    path = below(law, *what.split("."))
    for last in (_as_axis(context, on), "angular" if turns(context, on) else "linear"):
        if context.loaded.has(path[last]):
            return path[last]
    return path


def turns(context: Context, on: str) -> bool:
    """Whether a gain on an axis, a joint or an equation has the units of a rotation."""
    if on in context.equations:
        return context.equations[on].angular
    return on.startswith(("r", "joint."))


def _as_axis(context: Context, on: str) -> str:
    """The axis whose gain in the file an equation takes; any other is its own."""
    if on not in context.equations:
        return on
    return "rx" if context.equations[on].angular else "x"


def together(context: Context, sampled: SampledStage, what: str, on: str) -> tuple[str, ...]:
    """Axes and equations whose gain changes with that of `on`, itself first.

    They are those that take the same number of the file; of a designed gain those that have the
    same number, since the number that would replace it would be theirs too.

    Args:
        context: the task.
        sampled: the stage.
        what: the gain.
        on: an axis, a joint or an equation.
    """
    by = sampled.stage.plan.gains[what]
    if what == "joint_damping":
        return (on, *(other for other in by if other != on))
    path = gain_path(context, sampled.stage.name, what, on)
    return (
        on,
        *(
            other
            for other, gain in by.items()
            if other != on
            and gain == by[on]
            and turns(context, other) == turns(context, on)
            and (
                gain.origin != "file" or gain_path(context, sampled.stage.name, what, other) == path
            )
        ),
    )
