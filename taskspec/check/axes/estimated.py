"""Estimated frames: whether there is an estimate where they are used, and an x axis."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from taskspec.foresight.flow import followers, reached
from taskspec.program.context import Context
from taskspec.program.world.estimated_frames import LEAST_SINE
from taskspec.program.world.frames import FrameModel
from taskspec.spec import FILE, Stage
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.expression import Expression
from taskspec.text.expression.tree import Name, walk
from taskspec.text.source import Span

register(
    {
        "TS245": "a measured frame that is used before it is measured",
        "TS246": "a measured frame that may be used before it is measured",
    }
)


def check_estimated(context: Context, found: Diagnostics) -> None:
    """Reports stages that use a measured frame before it has been measured."""
    loaded = context.loaded
    stages = loaded.task.stages
    first = {next(iter(stages))}
    for name, stage in stages.items():
        for frame, place in _used(context, name, stage):
            if found.says("TS245", place):
                continue  # The file's frame is that of several stages.
            estimate = context.frames[frame.estimated_in].estimate
            if name not in reached(stages, followers(stages, estimate)):
                found.error(
                    "TS245",
                    f"stage {name!r} uses frame {frame.name!r}, which is measured at the end of "
                    f"{estimate!r}; that stage never comes before it",
                    place,
                    "use the frame in a stage that follows, or let it be measured by an earlier "
                    "one",
                )
            elif name in reached(stages, first, without=estimate) and name != estimate:
                found.warning(
                    "TS246",
                    f"stage {name!r} can be entered without stage {estimate!r} before it, which "
                    f"measures frame {frame.name!r}: the run stops there",
                    place,
                    f"lead every way to {name!r} through {estimate!r}",
                )
    for name, frame in context.frames.items():
        if frame.estimate:
            _check_heading(context, name, frame, found)


def _check_heading(context: Context, name: str, frame: FrameModel, found: Diagnostics) -> None:
    if not context.start_gaps:
        return
    nearest = min(context.start_gaps, key=lambda o: context.start_gaps[o])
    normal = context.start_normals[nearest]
    heading = np.array([1.0, 0.0, 0.0]) if frame.heading is None else frame.heading
    if np.linalg.norm(np.cross(normal, heading)) < LEAST_SINE * np.linalg.norm(heading):
        found.error(
            "TS225",
            f"frame {name!r} has no x axis: its heading is along the normal of {nearest!r}",
            context.loaded.span(FILE.frames[name]),
            "give a heading that lies in the surface, such as heading: [0, 1, 0]",
        )


def _used(context: Context, name: str, stage: Stage) -> Iterator[tuple[FrameModel, Span | None]]:
    """The measured frames that a stage needs, and where it says so."""
    loaded = context.loaded
    own = context.frame_of(stage)
    if own.estimated_in:
        yield own, loaded.span(FILE.stages[name].frame if stage.frame else FILE.frame)
    for expression in _expressions(stage):
        for node in walk(expression.tree):
            if isinstance(node, Name) and node.frame is not None:
                frame = context.frames[node.frame]
                if frame.estimated_in:
                    yield frame, expression.where(node)


def _expressions(stage: Stage) -> Iterator[Expression]:
    candidates: list[Expression | None] = [stage.until, stage.fail_if]
    for axis in stage.axes.values():
        candidates += [axis.velocity, axis.force, axis.torque, axis.position]
    for expression in candidates:
        if expression is not None:
            yield expression
