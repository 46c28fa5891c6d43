"""Force set points against the surface that is to return them, and against the limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.check.reach.rows import shares_of
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.known import known_value
from taskspec.program.limits.consistency import SET_POINT_SHARE
from taskspec.spec import FILE, AxisEntry, Stage
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.source import Span

register(
    {
        "TS308": "a pull on a surface that can only push",
        "TS610": "a limit below a set point",
    }
)


def check_set_points(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: NDArray[np.float64],
    found: Diagnostics,
) -> None:
    """Reports constant forces of stage `name` that pull, or that its own limit stops.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose. found: where findings go.
    """
    loaded = context.loaded
    stage = loaded.task.stages[name]
    contact = context.contact_of(context.frame_of(stage))
    most = context.limits_of(stage).force
    for axis, entry in stage.axes.items():
        wanted = steady_force(context, entry) if axis in axes else None
        if wanted is None:
            continue
        place = loaded.span(FILE.stages[name].axes[axis].force)
        if contact is not None:
            along = float(rotation[:, AXES.index(axis)] @ context.start_normals[contact])
            if abs(along) > MOSTLY and wanted * along > 0:
                found.warning(
                    "TS308",
                    f"{wanted:g} N along {axis!r} pulls on {contact!r}, which can only push back",
                    place,
                    "forces are what the robot applies: pressing goes against the outward normal",
                )
        if most is not None and abs(wanted) > shares_of(context, name).force * most:
            _beyond(context, stage, wanted, place, found)
    _check_constraints(context, name, found)


def _beyond(
    context: Context, stage: Stage, wanted: float, place: Span | None, found: Diagnostics
) -> None:
    """Reports a force [N] that is more than the limit of its stage."""
    most = context.limits_of(stage).force
    assert most is not None
    effect = (
        f"keeps this stage at {SET_POINT_SHARE * most:g} N instead of {abs(wanted):g} N"
        if context.law_of(stage).solve == "qp"
        else f"stops this stage before its {abs(wanted):g} N"
    )
    found.warning(
        "TS610",
        f"the limit on force, {most:g} N, {effect}",
        place,
        "raise the limit, for this stage by its own `limits`, or lower the force",
    )


def _check_constraints(context: Context, name: str, found: Diagnostics) -> None:
    """Reports constant set points that an equation can never return, or that a limit stops."""
    loaded = context.loaded
    stage = loaded.task.stages[name]
    most = context.limits_of(stage).force
    for equation, entry in stage.constraints.items():
        model = context.equations[equation]
        relation, wanted = model.constraint.relation, known_value(context, entry.wanted)
        presses = {"<=": 1, ">=": -1}.get(relation, 0)
        if wanted is None:
            continue
        kind, unit = ("torque", "N*m") if model.joints else ("force", "N")
        place = loaded.span(FILE.stages[name].constraints[equation][kind])
        share = shares_of(context, name).force
        if most is not None and abs(wanted) > share * most and not model.joints:
            _beyond(context, stage, wanted, place, found)
        if presses * wanted >= 0:
            continue
        found.warning(
            "TS308",
            f"{wanted:g} {unit} pulls on {equation!r}, which can only push back",
            place,
            f"under {relation} pressing is {'positive' if presses > 0 else 'negative'}: it goes "
            "along the gradient of left minus right",
        )


def steady_force(context: Context, axis: AxisEntry) -> float | None:
    """The set point where it does not depend on time or signals [N]."""
    force = None if axis.rotation else axis.set_point
    return None if force is None else known_value(context, force.wanted)
