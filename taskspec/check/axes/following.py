"""Axes that follow a mechanism, against its geometry."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import Axis
from taskspec.motion.path import PathShape
from taskspec.program.context import Context
from taskspec.program.reference.coupling import UncoupledError, coupling
from taskspec.program.reference.modes import plan_axes
from taskspec.spec import FILE
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics

register({"TS230": "an axis that does not follow from the mechanism's geometry"})


def check_following(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: NDArray[np.float64],
    path: PathShape | None,
    found: Diagnostics,
) -> None:
    """Reports axes of stage `name` that follow a mechanism which asks no motion of them.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose. path: of the stage. found: where findings go.
    """
    loaded = context.loaded
    stage = loaded.task.stages[name]
    plans = plan_axes(axes, stage.axes, path, context.law_of(stage), None)
    for axis, plan in plans.items():
        if plan.mode != "follows":
            continue
        try:
            coupling(context, context.frame_of(stage), rotation, plans, axis)
        except UncoupledError as error:
            place = loaded.span(FILE.stages[name].axes[axis].follows)
            found.error("TS230", str(error), place, error.hint)
