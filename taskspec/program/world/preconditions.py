"""Errors of a task's frames, equations and motions that keep it from being prepared."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from taskspec.expression.tree import Name, walk
from taskspec.program.errors import spec_error
from taskspec.program.world.frames import FrameModel, surface
from taskspec.program.world.mechanisms import mechanism_models
from taskspec.program.world.moving_base import MovingBase
from taskspec.robot import RobotModel
from taskspec.shapes.mesh import MeshError
from taskspec.spec import FILE, LoadedTask
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics, SpecError

register(
    {
        "TS226": "a frame placed in one that follows a surface or the force",
        "TS231": "a frame that turns with a handle, and cannot be as the file says",
        "TS247": "an equation in a frame that is not fixed in the world",
        "TS314": "an equation on a joint that the arm does not have",
    }
)

_NOT_FIXED = {
    "tool": "goes with the tool",
    "following": "follows a surface",
    "tracking": "turns with what it tracks",
    "estimated": "is measured only while the task runs",
}


def check_meshes(loaded: LoadedTask) -> None:
    """Reports meshes that cannot be touched.

    Raises:
        SpecError: there are such meshes (TS333).
    """
    found = Diagnostics(loaded.source.name)
    for name, shape in loaded.task.shapes.items():
        try:
            surface(shape)
        except MeshError as error:
            place = loaded.span(FILE.world[name].file)
            found.error("TS333", f"{name!r} cannot be touched: {error}", place, error.hint)
    if found.has_errors:
        raise SpecError(found.sorted(), loaded.sources)


def check_equations(
    loaded: LoadedTask, frames: Mapping[str, FrameModel], robot: RobotModel
) -> None:
    """Reports equations in frames that move, or on joints that the arm does not have.

    Raises:
        SpecError: there are such equations (TS247, TS314).
    """
    found = Diagnostics(loaded.source.name)
    for name, declared in loaded.task.equations.items():
        frame = frames[declared.frame or "world"]
        if frame.kind != "fixed":
            found.error(
                "TS247",
                f"equation {name!r} is written in frame {frame.name!r}, which "
                f"{_NOT_FIXED.get(frame.kind, 'moves')}",
                loaded.span(FILE.world[name].frame),
                "write it in a frame that is fixed in the world",
            )
        residual, joints = declared.equation.residual, robot.n
        for node in walk(residual.tree):
            if not isinstance(node, Name):
                continue
            if declared.equation.joints and _joint_of(node) > joints:
                message = f"{robot.name!r} has {joints} joints, q1 to q{joints}"
                found.error("TS314", message, residual.where(node))
            named = frames[node.path[0]] if len(node.path) == 2 else None
            if named is not None and named.kind not in ("fixed", "tool"):
                found.error(
                    "TS247",
                    f"equation {name!r} names an axis of {named.name!r}, which "
                    f"{_NOT_FIXED.get(named.kind, 'moves')}",
                    residual.where(node),
                    "name an axis of the tool, or of a frame that is fixed in the world",
                )
    if found.has_errors:
        raise SpecError(found.sorted(), loaded.sources)


def _joint_of(node: Name) -> int:
    """The joint, counted from 1, that a coordinate of an equation is of; 0 for any other name."""
    number = node.path[0].removeprefix("q")
    return int(number) if node.path[0].startswith("q") and number.isdigit() else 0


def check_motions(loaded: LoadedTask, bases: Mapping[str, MovingBase]) -> None:
    """Reports objects that are nowhere, or infinitely fast, as the run begins.

    Raises:
        SpecError: there are such objects (TS117).
    """
    found = Diagnostics(loaded.source.name)
    for name, base in bases.items():
        if not all(np.isfinite(np.array(value)).all() for value in base.numbers(0.0)):
            found.error(
                "TS117",
                "this motion has no finite place, velocity and acceleration at clock = 0 s",
                loaded.span(FILE.world[name].motion),
            )
    if found.has_errors:
        raise SpecError(found.sorted(), loaded.sources)


def check_parents(loaded: LoadedTask) -> None:
    """Reports frames that are placed where none can be.

    Raises:
        SpecError: a parent follows a surface (TS226), or turns while the control point stays
            (TS231).
    """
    frames = loaded.task.frames
    for name, frame in frames.items():
        parent = frames.get(frame.parent or "")
        if parent is not None and parent.surface is not None:
            raise spec_error(
                loaded,
                FILE.frames[name].parent,
                "TS226",
                f"frame {name!r} is placed in {frame.parent!r}, which follows a surface",
                "follow the surface itself, and turn x with 'heading'",
            )
        if parent is not None and parent.track is not None:
            raise spec_error(
                loaded,
                FILE.frames[name].parent,
                "TS226",
                f"frame {name!r} is placed in {frame.parent!r}, turning with the measured force",
                "track the force itself, and turn x with 'heading'",
            )
        _check_turning(loaded, name)


def _check_turning(loaded: LoadedTask, name: str) -> None:
    """Reports a control point at the origin of a frame that turns with a handle."""
    frames = loaded.task.frames
    if frames[name].point != "origin":
        return
    parent = frames[name].parent
    while parent in frames:
        parent = frames[parent].parent
    handles = {f"{m}.handle" for m, model in mechanism_models(loaded.task).items() if model.swings}
    if parent in handles:
        raise spec_error(
            loaded,
            FILE.frames[name].point,
            "TS231",
            f"frame {name!r} turns with {parent!r}, and keeps the control point at the tool tip",
            "leave 'point' out, or place the frame in the mechanism's own axes",
        )
