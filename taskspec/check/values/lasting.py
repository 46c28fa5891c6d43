"""Moves and paths that take longer than any run, or no time at all."""

from __future__ import annotations

from taskspec.geometry.axis import AXES
from taskspec.motion.path import PathShape
from taskspec.program.context import Context
from taskspec.program.execution.tracks import MOVE_SPEED
from taskspec.spec import FILE
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.show import show
from taskspec.text.source import Span

#: A hundred days, and a share of any tick [s]: numbers of jerk-limited moves fail far beyond both.
_LONGEST, _SHORTEST = 1e7, 1e-9
#: What is shorter is no motion [m, rad].
_NOWHERE = 1e-12


def check_lasting(context: Context, name: str, path: PathShape | None, found: Diagnostics) -> bool:
    """Whether moves and path of stage `name` last a time that can be simulated; reports others.

    Args:
        context: the task. name: of the stage. path: its path. found: where findings go.
    """
    stage, loaded = context.loaded.task.stages[name], context.loaded
    fits = True
    for axis, entry in stage.axes.items():
        if entry.move is not None:
            kind = "angular" if axis.is_rotation else "linear"
            key = "move" if entry.speed is None else "speed"
            place = loaded.span(FILE.stages[name].axes[axis][key])
            fits &= _fits(abs(entry.move), entry.speed or MOVE_SPEED[kind], place, found)
    if path is not None:
        _check_radius(context, name, path, found)
    if path is not None and path.speed is not None:
        length = path.table.length if path.table else path.length(dict.fromkeys(AXES, 0.0))
        place = loaded.span(FILE.stages[name].path.speed)
        fits &= _fits(length, path.speed, place, found)
    return fits


def _check_radius(context: Context, name: str, path: PathShape, found: Diagnostics) -> None:
    """Reports an arc about the very point where its stage begins."""
    loaded = context.loaded
    if path.kind != "arc" or context.frame_of(loaded.task.stages[name]).still:
        return
    if path.length(dict.fromkeys(AXES, 0.0)) <= _NOWHERE:
        found.warning(
            "TS222",
            "this arc has no radius: in this frame x and y count from where the stage begins",
            loaded.span(FILE.stages[name].path.arc),
            "put the center beside the tool, such as center: [20 mm, 0]",
        )


def _fits(length: float, speed: float, place: Span | None, found: Diagnostics) -> bool:
    lasts = length / speed
    if length <= _NOWHERE or _SHORTEST <= lasts <= _LONGEST:
        return True
    found.error(
        "TS118",
        f"at this speed the motion takes {show(lasts, 's', 2)}",
        place,
        "mind the units of the way and of the speed",
    )
    return False
