"""Numbers that are right by their dimension and hardly meant: off by a thousand, or by a sign."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.check.contact.set_points import steady_force
from taskspec.geometry.axis import AXES, Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.spec import FILE
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.show import show

register({"TS129": "a number that is hardly meant"})

Vector = NDArray[np.float64]

#: Rubber on dry concrete has about 1, soft rubber on glass 2.
_ROUGHEST = 2.0
#: A contact that gives way by more than this is none that the laws are meant for [m].
_DEEPEST = 0.05


def check_plausible(context: Context, found: Diagnostics) -> None:
    """Reports coefficients of friction that no surfaces have."""
    loaded = context.loaded
    for name, shape in loaded.task.shapes.items():
        if shape.friction > _ROUGHEST:
            found.warning(
                "TS129",
                f"a coefficient of friction of {shape.friction:g}: dry rubber has about 1",
                loaded.span(FILE.world[name].friction),
                "it is a plain number, such as 0.2; a percentage takes its sign: 20 %",
            )


def check_depth(
    context: Context, name: str, axes: tuple[Axis, ...], rotation: Vector, found: Diagnostics
) -> None:
    """Reports a force of stage `name` that deforms its contact farther than contacts give way.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose. found: where findings go.
    """
    loaded = context.loaded
    stage = loaded.task.stages[name]
    contact = context.contact_of(context.frame_of(stage))
    if contact is None or contact not in context.compliances:
        return
    stiffness = context.compliances[contact].stiffness
    for axis, entry in stage.axes.items():
        wanted = steady_force(context, entry) if axis in axes else None
        if wanted is None:
            continue
        along = float(rotation[:, AXES.index(axis)] @ context.start_normals[contact])
        depth = abs(wanted) / stiffness
        if abs(along) < MOSTLY or depth < _DEEPEST:
            continue
        place = loaded.span(FILE.world[contact].stiffness)
        if not found.says("TS129", place):
            found.warning(
                "TS129",
                f"{show(abs(wanted), 'N')} on a stiffness of {show(stiffness, 'N/m')} deform "
                f"{contact!r} by {show(depth, 'mm', 3)}",
                place,
                "steel on a table is some 100 kN/m, rubber 10 kN/m, foam 1 kN/m; mind the k of "
                "kN/m",
            )
