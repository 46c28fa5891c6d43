"""Faults of `truth` that the robot cannot have: joints that it lacks, angles of slides."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.program.plan import TaskPlan
from taskspec.rules import Finding, Phase, error, rule
from taskspec.spec import FILE
from taskspec.text.units import describe


@rule({}, also=("TS414", "TS713"), phase=Phase.TASK, bars=True)
def faults_of_joints(task: TaskPlan) -> Iterator[Finding]:
    """Faults of joints that the robot does not have, or in units that they do not have."""
    robot, n = task.context.robot, task.context.robot.n
    for i, fault in enumerate(task.context.loaded.task.truth.faults):
        place = FILE.truth.faults[i]
        for number in fault.joint:
            if number > n:
                yield error(
                    "TS414",
                    f"{robot.name!r} has no joint {number}",
                    place.joint,
                    f"its joints are 1 to {n}",
                )
            elif not fault.fits(turns=robot.hinges[number - 1]):
                moves = "turns" if robot.hinges[number - 1] else "slides"
                size = describe(fault.effect.size.dimension)
                yield error(
                    "TS713",
                    f"joint {number} ({robot.joint_names[number - 1]}) {moves}, and this is {size}",
                    place[fault.device],
                    "write degrees and N*m of joints that turn, mm and N of those that slide",
                )
        if not fault.channels(robot.hinges):
            size = describe(fault.effect.size.dimension)
            yield error(
                "TS713",
                f"{robot.name!r} has no joint of which this, {size}, could be",
                place[fault.device],
                "write degrees and N*m of joints that turn, mm and N of those that slide",
            )
