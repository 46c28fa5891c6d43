"""Protections that do not fit their robot; whether a task keeps to them its trial finds."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.plan import TaskPlan
from taskspec.rules import Finding, Phase, error, rule
from taskspec.spec import FILE


@rule({}, also=("TS414",), phase=Phase.TASK, bars=True)
def protected_joints(task: TaskPlan) -> Iterator[Finding]:
    """Protections that have another number of values than the robot has joints."""
    protection, robot = task.context.loaded.task.robot.protection, task.context.robot
    if protection is None or protection.joints is None:
        return
    n = robot.n
    for key, values in protection.joints.given:
        assert isinstance(values, tuple)
        if len(values) not in (1, n):
            yield error(
                "TS414",
                f"{len(values)} values for the {n} joints of {robot.name!r}",
                FILE.robot.protection.joints[key],
                "one value for all joints, or one for each",
            )
