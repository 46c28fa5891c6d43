"""Force control that begins in the air."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.axis import AXES, Axis
from taskspec.laws.gains import on_axis
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.known import known_value
from taskspec.spec import FILE
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.show import show

register(
    {
        "TS615": "force control that begins off the surface",
        "TS619": "a ramp that is longer than its stage",
    }
)


def check_ramps(context: Context, name: str, axes: tuple[Axis, ...], found: Diagnostics) -> None:
    """Reports set points of stage `name` that are not reached before its time is over.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        found: where findings go.
    """
    stage = context.loaded.task.stages[name]
    if stage.time is None or stage.until is not None:
        return
    for axis, entry in stage.axes.items():
        key = "torque" if axis.is_rotation else "force"
        force = entry.set_point
        wanted = None if force is None else known_value(context, force.wanted)
        if force is None or not wanted or axis not in axes or force.rise <= stage.time:
            continue
        given = force.ramp is not None
        found.warning(
            "TS619",
            f"the set point is reached in {show(force.rise, 's', 3)}, and the stage ends after "
            f"{show(stage.time, 's', 3)}",
            context.loaded.span(FILE.stages[name].axes[axis]["ramp" if given else key]),
            "let the stage last longer, or shorten the ramp",
        )


def check_entering(
    context: Context,
    name: str,
    axes: tuple[Axis, ...],
    rotation: NDArray[np.float64],
    gap: float | None,
    found: Diagnostics,
) -> None:
    """Reports a stage that presses on a surface which it does not touch as it begins.

    A force loop in the air goes at f_d/d towards the surface, d its damping, and at twice that once
    its integral is full. What it covers while the set point is ramped is no matter.

    Args:
        context: the task. name: of the stage. axes: that exist in its frame.
        rotation: (3, 3) its frame at the start pose.
        gap: to the nominal contact as the stage begins [m]; None where it is not known.
        found: where findings go.
    """
    loaded = context.loaded
    stage = loaded.task.stages[name]
    frame, law = context.frame_of(stage), context.law_of(stage)
    contact = context.contact_of(frame)
    if contact is None or gap is None or not law.control_law.force_loop:
        return
    normal = context.start_normals[contact]
    for axis, entry in stage.axes.items():
        force = None if axis.is_rotation else entry.set_point
        wanted = None if force is None else known_value(context, force.wanted)
        if force is None or not wanted or axis not in axes or entry.mode.travels:
            continue
        along = float(rotation[:, AXES.index(axis)] @ normal)
        if abs(along) < MOSTLY or wanted * along > 0:
            continue
        felt = context.felt_stiffness(frame, axes, rotation)
        plants = context.plants(axes, rotation, felt, lever=context.lever_of(frame))
        gains = law.design({axis: entry}, {axis: plants[axis]})
        damping = law.control_law.loop_damping(on_axis(gains, axis))
        if gap * damping <= abs(wanted) * force.rise / 2:
            continue
        speed = "" if not damping else f" at up to {show(2 * abs(wanted) / damping, 'mm/s', 2)}"
        found.warning(
            "TS615",
            f"stage {name!r} presses {show(gap, 'mm', 3)} off {contact!r}: nothing returns the "
            f"force, and the tool goes there{speed}",
            loaded.span(FILE.stages[name].axes[axis].force),
            "let a stage before it touch: a velocity until a force is felt",
        )
