"""Frames and objects at the start: what is not defined there, and what is already touched."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from taskspec.geometry.axis import AXES, Axis
from taskspec.program.axes import MOSTLY
from taskspec.program.context import Context
from taskspec.program.prepare import chart_at, pose_of_base, tool_center
from taskspec.program.world.stiffness import RESOLVED_PHASE
from taskspec.shapes import SHAPES
from taskspec.signals.entries import TOUCHING
from taskspec.spec import FILE
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.show import show

register(
    {
        "TS225": "a following frame without an x axis at the start",
        "TS232": "a rotation held against the world on an object that turns",
        "TS248": "a frame that does not go with its loose body",
        "TS305": "a start inside an object",
        "TS307": "a contact stiffer than the plant's steps resolve",
        "TS326": "a tool that points away from its surface",
    }
)

#: Cosine from which on a tool points away: 60 deg.
_AWAY = 0.5
#: Arms with so many axes move in a plane, and their tool cannot be turned out of it.
_PLANAR = 3


def check_frame(context: Context, name: str, found: Diagnostics) -> bool:
    """Whether the frame of stage `name` has axes at the start pose; reports where it has not."""
    loaded = context.loaded
    stage = loaded.task.stages[name]
    frame = context.frame_of(stage)
    if not _turning_fits(context, name, found):
        return False
    _check_loose(context, name, found)
    if frame.kind != "following":
        return True
    assert frame.surface is not None
    A, a = pose_of_base(context, frame)
    center = A.T @ (tool_center(context) - a)
    chart = chart_at(frame.surface, center)
    normal = np.array(ca.evalf(chart.normal(ca.SX(center)))).ravel()
    heading = np.array(ca.evalf(chart.reference_direction(frame.heading))).ravel()
    share = abs(normal @ heading) / np.linalg.norm(heading)
    margin = float(ca.evalf(chart.margin(ca.SX(center), frame.heading)))
    if not np.isfinite(normal).all() or (share < 1 - 1e-3 and margin < 0):
        found.error(
            "TS225",
            f"the tool does not start over the part of {frame.surface_name!r} that frame "
            f"{frame.name!r} follows",
            loaded.span(FILE.robot.start),
            "start " + ", ".join(s.start_over for s in SHAPES.values() if s.start_over),
        )
        return False
    if share < 1 - 1e-3:
        return True
    given = frame.heading is not None
    place = FILE.frames[frame.name]["heading" if given else "surface"]
    found.error(
        "TS225",
        f"frame {frame.name!r} has no x axis where the tool starts: its heading is along the "
        "normal there",
        loaded.span(place),
        "give a heading that lies in the surface, such as heading: [0, 1, 0]",
    )
    return False


def _check_loose(context: Context, name: str, found: Diagnostics) -> None:
    """Reports a frame of stage `name` on a loose body, which stays where that is declared."""
    loaded = context.loaded
    stage = loaded.task.stages[name]
    frame = context.frame_of(stage)
    owner = frame.surface_name or frame.owner
    shape = loaded.task.shapes.get(owner or "")
    if shape is None or not shape.free or owner == loaded.task.robot.grasp:
        return
    place = loaded.span(FILE.stages[name].frame if stage.frame else FILE.frame)
    if found.says("TS248", place):
        return
    found.warning(
        "TS248",
        f"{owner!r} is loose, and nothing tells the robot where it goes: frame {frame.name!r} "
        "stays where it is declared",
        place,
        "follow what stands still, or hold the body: robot.grasp",
    )


def _turning_fits(context: Context, name: str, found: Diagnostics) -> bool:
    """Whether what stage `name` asks of a turning frame can be; reports what cannot."""
    loaded = context.loaded
    stage = loaded.task.stages[name]
    frame, base = context.frame_of(stage), context.base_of(context.frame_of(stage))
    place = loaded.span(FILE.stages[name].frame if stage.frame else FILE.frame)
    held = [a for a, entry in stage.axes.items() if entry.hold == "world"]
    if base is not None and base.turns and held:
        found.error(
            "TS232",
            f"{base.name!r} turns, and {held[0]!r} of a frame on it cannot hold the world's "
            "orientation",
            loaded.span(FILE.stages[name].axes[held[0]]),
            "take a frame that does not turn with the object, or write 'hold'",
        )
        return False
    if frame.mechanism is None:
        return True
    _check_knob(context, name, held, found)
    if context.held not in ("", frame.mechanism.name):
        found.error(
            "TS231",
            f"frame {frame.name!r} turns with the handle of {frame.mechanism.name!r}, and the "
            f"robot holds that of {context.held!r}",
            place,
            f"take {context.held}.handle",
        )
        return False
    if float(ca.evalf(frame.mechanism.margin(ca.SX(context.start_p)))) < 0:
        found.error(
            "TS231",
            f"the tool starts at the axis of {frame.mechanism.name!r}, where frame "
            f"{frame.name!r} has no axes",
            loaded.span(FILE.robot.start),
            f"start at the handle: robot.grasp: {frame.mechanism.name}.handle",
        )
        return False
    return True


def _check_knob(context: Context, name: str, held: list[Axis], found: Diagnostics) -> None:
    """Reports rotations held against the world about the axis of a handle with a fixed knob."""
    loaded = context.loaded
    frame = context.frame_of(loaded.task.stages[name])
    mechanism = frame.mechanism
    assert mechanism is not None
    if mechanism.free or mechanism.name != context.held:
        return
    for axis in held:
        if abs(frame.rotation[2, AXES.index(axis) % 3]) > MOSTLY:
            found.warning(
                "TS232",
                f"the knob of {mechanism.name!r} is fixed, so the tool turns with it, and {axis!r} "
                "holds against that",
                loaded.span(FILE.stages[name].axes[axis]),
                f"write {axis}: {{follows: {mechanism.name}}}, or knob: free",
            )


def check_pointing(context: Context, name: str, found: Diagnostics) -> None:
    """Reports a tool that starts pointing away from the surface which stage `name` is about.

    A force of the stage, or a motion until something is felt, would have to go through the tool's
    stem. A ball that touches with its side is no such tool.
    """
    loaded = context.loaded
    stage = loaded.task.stages[name]
    contact = context.contact_of(context.frame_of(stage))
    touches = stage.until is not None or any(e.has_force for e in stage.axes.values())
    if contact is None or not touches or loaded.task.robot.grasp is not None:
        return
    if len(context.robot.axes) <= _PLANAR or context.start_gaps[contact] < 0:
        return
    along = float(context.start_R[:, 2] @ context.start_normals[contact])
    place = loaded.span(FILE.robot.start)
    if along > _AWAY and not found.says("TS326", place):
        found.warning(
            "TS326",
            f"the tool starts pointing away from {contact!r}, at "
            f"{show(math.pi - math.acos(min(along, 1.0)), 'deg', 3)} to its inward normal",
            place,
            "z of the tip points out of the tool: straight down is rpy: [180 deg, 0, 0]",
        )


def check_stiffness(context: Context, found: Diagnostics) -> None:
    """Reports contacts that the plant's steps do not resolve."""
    loaded = context.loaded
    for name, contact in context.compliances.items():
        if contact.phase > RESOLVED_PHASE:
            most = contact.stiffness * (RESOLVED_PHASE / contact.phase) ** 2
            found.warning(
                "TS307",
                f"{name!r} is stiffer than the plant's steps resolve: up to "
                f"{show(most, 'kN/m', 3)} on this arm at this rate",
                loaded.span(FILE.world[name].stiffness),
                "raise control.plant_rate, or write `rigid`",
            )


def check_start(context: Context, found: Diagnostics) -> None:
    """Reports objects that the tool is inside of at the start."""
    loaded = context.loaded
    for name, gap in context.touchable_gaps.items():
        force = -gap * context.compliances[name].stiffness
        if force > TOUCHING:
            found.warning(
                "TS305",
                f"the tool starts {show(-gap, 'mm')} inside {name!r}: the run begins with "
                f"{show(force, 'N', 3)} of contact",
                loaded.span(FILE.robot.start),
                "start above the surface, and approach it with a guarded stage",
            )
