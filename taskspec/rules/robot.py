"""The robot as a task has it: values for its joints, and where its tool starts."""

from __future__ import annotations

import math
from collections.abc import Iterator

from taskspec.program.plan import StagePlan, TaskPlan
from taskspec.robot import RobotError, check_joints
from taskspec.rules import Finding, Phase, error, rule, warning
from taskspec.signals.entries import TOUCHING
from taskspec.spec import FILE, KeyPath, below
from taskspec.text.units import show

#: Cosine from which on a tool points away: 60 deg.
_AWAY = 0.5
#: Arms with so many axes move in a plane, and their tool cannot be turned out of it.
_PLANAR = 3


@rule("TS414", "values for joints that do not fit the robot", also=("TS411",), phase=Phase.TASK)
def joint_values(task: TaskPlan) -> Iterator[Finding]:
    """Postures and dampings that do not fit the robot's joints."""
    robot, spec = task.context.robot, task.context.loaded.task
    if spec.robot.posture is not None:
        try:
            check_joints(robot, spec.robot.posture, "the posture", ("posture",))
        except RobotError as reason:
            place = below(FILE.robot, *reason.field)
            yield error(reason.code, reason.message, place, reason.hint)
    lists: list[tuple[KeyPath, tuple[float, ...]]] = [
        (FILE.robot.joint_damping, spec.robot.joint_damping)
    ]
    lists += [
        (FILE.stages[name].law.damping if stage.spec.law else FILE.law.damping, damping)
        for name, stage in task.stages.items()
        if (damping := stage.law.joint_damping) is not None
    ]
    n = robot.pin.nv
    for place, values in lists:
        if len(values) not in (1, n):
            yield error(
                "TS414",
                f"{len(values)} values for the {n} joints of {robot.name!r}",
                place,
                "one value for all joints, or one for each",
            )


@rule("TS305", "a start inside an object", phase=Phase.TASK)
def start_inside(task: TaskPlan) -> Iterator[Finding]:
    """Objects that the tool is inside of at the start."""
    context = task.context
    for name, gap in context.touchable_gaps.items():
        force = -gap * context.compliances[name].stiffness
        if force > TOUCHING:
            yield warning(
                "TS305",
                f"the tool starts {show(-gap, 'mm')} inside {name!r}: the run begins with "
                f"{show(force, 'N', 3)} of contact",
                FILE.robot.start,
                "start above the surface, and approach it with a guarded stage",
            )


@rule("TS326", "a tool that points away from its surface", phase=Phase.AXES)
def pointing_away(stage: StagePlan) -> Iterator[Finding]:
    """A tool that starts pointing away from the surface which a stage is about.

    A force of the stage, or a motion until something is felt, would have to go through the tool's
    stem. A ball that touches with its side is no such tool.
    """
    context, contact = stage.context, stage.contact
    touches = stage.spec.until is not None or any(e.has_force for e in stage.spec.axes.values())
    if contact is None or not touches or context.loaded.task.robot.grasp is not None:
        return
    if len(context.robot.axes) <= _PLANAR or context.start_gaps[contact] < 0:
        return
    along = float(context.start_R[:, 2] @ context.start_normals[contact])
    if along > _AWAY:
        yield warning(
            "TS326",
            f"the tool starts pointing away from {contact!r}, at "
            f"{show(math.pi - math.acos(min(along, 1.0)), 'deg', 3)} to its inward normal",
            FILE.robot.start,
            "z of the tip points out of the tool: straight down is rpy: [180 deg, 0, 0]",
            unless=("TS326",),
        )
