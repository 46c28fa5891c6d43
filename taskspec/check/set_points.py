"""Force set points against the surface that is to return them, and against the limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.check.known import known_value
from taskspec.control.state import AXES
from taskspec.program.consistency import SET_POINT_SHARE
from taskspec.program.context import Context
from taskspec.program.modes import MOSTLY
from taskspec.spec import Axis
from taskspec.text.diagnostic import Diagnostics


def check_set_points(
    context: Context,
    name: str,
    axes: tuple[str, ...],
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
        place = loaded.span(("stages", name, "axes", axis, "force"))
        if contact is not None:
            along = float(rotation[:, AXES.index(axis)] @ context.start_normals[contact])
            if abs(along) > MOSTLY and wanted * along > 0:
                found.warning(
                    "TS308",
                    f"{wanted:g} N along {axis!r} pulls on {contact!r}, which can only push back",
                    place,
                    "forces are what the robot applies: pressing goes against the outward normal",
                )
        if most is not None and abs(wanted) > most:
            kept = context.law_of(stage).solve == "qp"
            effect = (
                f"keeps this stage at {SET_POINT_SHARE * most:g} N instead of {abs(wanted):g} N"
                if kept
                else f"stops this stage before its {abs(wanted):g} N"
            )
            found.warning(
                "TS610",
                f"the limit on force, {most:g} N, {effect}",
                place,
                "raise the limit, for this stage by its own `limits`, or lower the force",
            )


def steady_force(context: Context, axis: Axis) -> float | None:
    """The set point where it does not depend on time or signals [N]."""
    return None if axis.force is None else known_value(context, axis.force)
