"""Axes that a stage names but the arm does not have."""

from __future__ import annotations

from taskspec.program.context import Context
from taskspec.text.diagnostic import Diagnostics


def check_axes(context: Context, name: str, axes: tuple[str, ...], found: Diagnostics) -> None:
    """Reports axes of stage `name` that do not exist in its frame; `axes` are those that do."""
    loaded, robot = context.loaded, context.robot
    frame = context.frame_of(loaded.task.stages[name])
    for axis in loaded.task.stages[name].axes:
        if axis not in axes:
            found.error(
                "TS220",
                f"{robot.name!r} cannot move {_how(axis)} of frame {frame.name!r}",
                loaded.span(("stages", name, "axes", axis), key=True),
                f"axes that exist here: {', '.join(axes)}",
            )
    posture = loaded.task.robot.posture
    if posture is not None and len(posture) != robot.pin.nv:
        found.error(
            "TS411",
            f"`posture` has {len(posture)} joint positions, {robot.name!r} has {robot.pin.nv}",
            loaded.span(("robot", "posture")),
        )


def _how(axis: str) -> str:
    return f"about {axis[1:]!r}" if axis.startswith("r") else f"along {axis!r}"
