"""Axes that a stage names: whether the arm has them, and whether they can follow a mechanism."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.geometry.axis import Axis
from taskspec.modes import UncoupledError
from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, Phase, error, rule
from taskspec.spec import FILE, key_of


@rule({}, also=("TS220",), phase=Phase.AXES)
def missing_axes(stage: StagePlan) -> Iterator[Finding]:
    """Axes that do not exist in the stage's frame."""
    for axis in stage.spec.axes:
        if axis not in stage.axes:
            yield error(
                "TS220",
                f"{stage.context.robot.name!r} cannot move {_how(axis)} of frame "
                f"{stage.frame.name!r}",
                key_of(FILE.stages[stage.name].axes[axis]),
                f"axes that exist here: {', '.join(stage.axes)}",
            )


@rule("TS230", "an axis that does not follow from the mechanism's geometry", phase=Phase.PATH)
def uncoupled_axes(stage: StagePlan) -> Iterator[Finding]:
    """Axes that follow a mechanism which asks no motion of them."""
    for axis, plan in stage.plans.items():
        try:
            stage.coupling_of(axis)
        except UncoupledError as reason:
            place = FILE.stages[stage.name].axes[axis][plan.mode.name]
            # Neither references nor gains of such a stage exist, and nothing after it is known.
            yield error("TS230", str(reason), place, reason.hint, stops=True)


def _how(axis: Axis) -> str:
    return f"about {axis[1:]!r}" if axis.is_rotation else f"along {axis!r}"
