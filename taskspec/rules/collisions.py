"""Links of the arm that run into objects."""

from __future__ import annotations

from collections.abc import Iterator

from taskspec.foresight.collisions import TOOL_END, Surroundings
from taskspec.program.plan import TaskPlan
from taskspec.rules import Finding, Phase, rule, warning
from taskspec.rules.places import motion_of
from taskspec.text.units import show


@rule("TS428", "an arm that runs into an object", phase=Phase.RUN)
def collisions(task: TaskPlan) -> Iterator[Finding]:
    """Where a link, or on a path of joints the tool, is first in each object."""
    surroundings = Surroundings(task.context)
    told: set[str] = set()
    for stage in task.framed.values():
        met = surroundings.first(stage)
        if met is None or met.object in told:
            continue
        told.add(met.object)
        yield warning(
            "TS428",
            f"in stage {stage.name!r}, {_when(met.time)}, {_named(met.part)} runs into "
            f"{met.object!r}, and comes {show(met.depth, 'mm', 2)} into it: {_why(met.part)}",
            motion_of(stage),
            "lead the arm round it, start in another posture, or move the object",
        )


def _when(time: float) -> str:
    return f"at t = {show(time, 's', 3)}" if time else "where it begins"


def _named(part: str) -> str:
    return part if part == TOOL_END else f"link {part!r}"


def _why(part: str) -> str:
    if part == TOOL_END:
        return "a path of joints gives way to nothing"
    return "in a run only the tool's end touches, a robot does with all of itself"
