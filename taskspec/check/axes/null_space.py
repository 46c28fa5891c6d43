"""Goals in the null space of an arm that has none, or nothing for them to do."""

from __future__ import annotations

from taskspec.geometry.axis import Axis
from taskspec.program.context import Context
from taskspec.program.stages.null_space import bounded
from taskspec.spec import FILE
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics

register({"TS233": "a goal in the null space that has no effect on this arm"})


def check_null_space(
    context: Context, name: str, axes: tuple[Axis, ...], found: Diagnostics
) -> None:
    """Warns of goals in the null space that change nothing in stage `name` with its `axes`."""
    loaded, robot = context.loaded, context.robot
    stage = loaded.task.stages[name]
    law = context.law_of(stage)
    if "null_space" not in law.model_fields_set:
        return
    owner = FILE.stages[name].law if stage.law is not None else FILE.law
    n, place = robot.pin.nv, loaded.span(owner.null_space)
    if n == len(axes):
        found.warning(
            "TS233",
            f"{robot.name!r} has no null space: its {n} joints all serve {', '.join(axes)}",
            place,
            "leave it out, or take an arm with more joints",
        )
    elif "joint-limits" in law.null_space and not bounded(robot):
        found.warning("TS233", f"no joint of {robot.name!r} has limits to keep away from", place)
