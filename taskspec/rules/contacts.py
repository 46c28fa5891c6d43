"""Rules about the object that an axis presses on."""

from __future__ import annotations

from collections.abc import Iterator

import casadi as ca

from taskspec.program.known_value import known_value
from taskspec.program.plan import StagePlan
from taskspec.rules import Finding, rule, warning
from taskspec.shapes.plate import CutPlate
from taskspec.spec import FILE
from taskspec.text.units import show


@rule("TS327", "a force along which no object lies")
def nothing_ahead(stage: StagePlan) -> Iterator[Finding]:
    """A force on an axis along which the tool meets nothing that would return it."""
    context = stage.context
    if (
        stage.contacts.gripped
        or context.equations
        or context.bushings
        or not context.touchable_gaps
    ):
        return
    for axis in stage.contacts.forces:
        expression = stage.spec.axes[axis].force
        wanted = None if expression is None else known_value(context, expression)
        if stage.contacts.by_axis[axis] is not None or not wanted or _over_a_cut(stage):
            continue
        yield warning(
            "TS327",
            f"no object lies along {axis!r} from where the tool is as stage {stage.name!r} starts, "
            f"and {show(wanted, 'N')} are commanded there",
            FILE.stages[stage.name].axes[axis].force,
            "start where one is ahead, or name it by 'contact'",
            unless=("TS303", "TS320", "TS420"),
        )


def _over_a_cut(stage: StagePlan) -> bool:
    """Whether a stage starts over a cut, whose walls return forces that nothing else does."""
    p, _ = stage.kinematics.tool
    cuts = [s for s in stage.context.surfaces.values() if isinstance(s, CutPlate)]
    return any(float(ca.evalf(each.beside(each.local(ca.SX(p))))) < 0 for each in cuts)
