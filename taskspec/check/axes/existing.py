"""Axes that a stage names but the arm does not have."""

from __future__ import annotations

from taskspec.geometry.axis import Axis
from taskspec.program.context import Context
from taskspec.robot import RobotError
from taskspec.robot import check_joints as posture_of_joints
from taskspec.spec import FILE, KeyPath, below, key_of
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics

register({"TS414": "values for joints that do not fit the robot"})


def check_axes(context: Context, name: str, axes: tuple[Axis, ...], found: Diagnostics) -> None:
    """Reports axes of stage `name` that do not exist in its frame; `axes` are those that do."""
    loaded, robot = context.loaded, context.robot
    frame = context.frame_of(loaded.task.stages[name])
    for axis in loaded.task.stages[name].axes:
        if axis not in axes:
            found.error(
                "TS220",
                f"{robot.name!r} cannot move {_how(axis)} of frame {frame.name!r}",
                loaded.span(key_of(FILE.stages[name].axes[axis])),
                f"axes that exist here: {', '.join(axes)}",
            )


def check_joints(context: Context, found: Diagnostics) -> None:
    """Reports values for joints that do not fit the robot's."""
    loaded, n = context.loaded, context.robot.pin.nv
    task = loaded.task
    if task.robot.posture is not None:
        try:
            posture_of_joints(context.robot, task.robot.posture, "the posture", ("posture",))
        except RobotError as error:
            place = below(FILE.robot, *error.field)
            found.error(error.code, error.message, loaded.span(place), error.hint)
    lists: list[tuple[KeyPath, tuple[float, ...]]] = [
        (FILE.robot.joint_damping, task.robot.joint_damping)
    ]
    lists += [
        (FILE.stages[name].law.damping if stage.law else FILE.law.damping, damping)
        for name, stage in task.stages.items()
        if (damping := context.law_of(stage).joint_damping) is not None
    ]
    for place, values in lists:
        if len(values) not in (1, n):
            found.error(
                "TS414",
                f"{len(values)} values for the {n} joints of {context.robot.name!r}",
                loaded.span(place),
                "one value for all joints, or one for each",
            )


def _how(axis: Axis) -> str:
    return f"about {axis[1:]!r}" if axis.is_rotation else f"along {axis!r}"
