"""Forces that nothing in the world returns: artificial against natural constraints, by rank."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taskspec.geometry.axis import Axis
from taskspec.program.context import Context
from taskspec.program.plan import StagePlan
from taskspec.program.reference.orientation import representation_of
from taskspec.rules import Finding, info, rule
from taskspec.spec import FILE, KeyPath, key_of
from taskspec.statics.resistance import resists
from taskspec.text.diagnostic import Severity
from taskspec.text.units import FORCE, show

_TIMES = (0.0, 0.13, 0.37, 1.0, 2.9)
#: A contradiction of lines, or an open-loop force without a surface, says it already.
_SAID_BY = ("TS303", "TS420")


@rule("TS320", "a force that nothing resists")
def unresisted_forces(stage: StagePlan) -> Iterator[Finding]:
    """Set points of force loops on axes along and about which nothing resists."""
    law = stage.law.control_law
    severity = Severity.WARNING if law.shares or stage.law.solve == "qp" else Severity.ERROR
    for axis, value, place in _unresisted(stage):
        turns = axis.is_rotation
        if value:
            yield Finding(
                "TS320",
                f"nothing resists {show(value, axis.of(FORCE))} "
                f"{'about' if turns else 'along'} {axis!r}: {_reason(stage.context, turns)}, "
                f"and the tool {'turns' if turns else 'runs'} away",
                place,
                f"move or hold {axis!r} instead, or declare under 'world' what is to resist",
                unless=_SAID_BY,
                severity=severity,
            )


@rule("TS325", "an axis that nothing determines")
def undetermined_axes(stage: StagePlan) -> Iterator[Finding]:
    """Axes without a motion, along which neither a force is set nor can be.

    That f = 0 there is natural already, so stating it is no constraint: what is left of the law is
    its damping. One that is `free` is meant so.
    """
    if stage.law.control_law.shares:
        return
    places = {
        axis: place
        for axis, value, place in _unresisted(stage)
        # Euler angles leave no rotation to a torque, which TS228 says.
        if not (value or stage.plans[axis].mode.lets_go)
        and not (axis.is_rotation and representation_of(stage.law) is not None)
    }
    if not places:
        return
    turning = sorted({axis.is_rotation for axis in places})
    efforts = " or ".join("moment" if turns else "force" for turns in turning)
    reasons = dict.fromkeys(_reason(stage.context, turns) for turns in turning)
    freely = " and ".join("turn" if turns else "go" for turns in turning)
    several = len(places) > 1
    *names, last = map(repr, places)
    named = f"{', '.join(names)} and {last}" if several else last
    them = "them" if several else "it"
    first = next(iter(places.values()))
    yield info(
        "TS325",
        f"nothing determines {named}: no {efforts} is commanded, "
        f"and {', and '.join(reasons)}; only damping keeps the tool there",
        key_of(FILE.stages[stage.name].axes) if several else first,
        f"hold {them} or move {them}, "
        f"unless {'the tool' if several else 'it'} is to {freely} freely",
        unless=_SAID_BY,
        unless_at=first,
    )


def _unresisted(stage: StagePlan) -> Iterator[tuple[Axis, float, KeyPath]]:
    """Axes of force loops that nothing resists: their set points, and where these stand."""
    if not stage.law.control_law.force_loop:
        return
    for axis in stage.spec.axes:
        value = _set_point(stage, axis) if axis in stage.axes else None
        if value is not None and not resists(stage, axis):
            yield axis, value, FILE.stages[stage.name].axes[axis][axis.effort]


def _set_point(stage: StagePlan, axis: Axis) -> float | None:
    """A set point, not zero if it is ever another [N, N m]; None where signals decide it."""
    force = stage.spec.axes[axis].set_point
    if force is None:
        return None
    values = [stage.known(force.wanted, {"t": t, "clock": t}) for t in _TIMES]
    if any(v is None or not np.isfinite(v) for v in values):
        return None
    return next((v for v in values if v), 0.0)


def _reason(context: Context, turns: bool) -> str:
    task = context.loaded.task
    objects = [*task.shapes, *task.equations, *task.bushings]
    if turns and context.held:
        return f"the knob of {context.held!r} turns freely"
    if not objects:
        return "there is nothing in the world to push on"
    if turns:
        touching = "a ball touches in one point" if task.shapes else "an equation holds one point"
        return f"{touching} and bears no moment"
    listed = ", ".join(map(repr, objects))
    return f"without friction {listed} {'returns' if len(objects) == 1 else 'return'} none there"
