"""Frames and objects at the start: what is not defined there, and what is already touched."""

from __future__ import annotations

import casadi as ca
import numpy as np

from taskspec.program.context import Context
from taskspec.program.prepare import box_face_at, tool_center
from taskspec.program.signals import TOUCHING
from taskspec.program.stiffness import RESOLVED_PHASE
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.show import show


def check_frame(context: Context, name: str, found: Diagnostics) -> bool:
    """Whether the frame of stage `name` has axes at the start pose; reports where it has not."""
    loaded = context.loaded
    frame = context.frame_of(loaded.task.stages[name])
    if frame.kind != "following":
        return True
    assert frame.surface is not None
    center = tool_center(context)
    face = box_face_at(frame.surface, center)
    chart = frame.surface.chart(face)
    normal = np.array(ca.evalf(chart.normal(ca.SX(center)))).ravel()
    heading = np.array(ca.evalf(chart.reference_direction(frame.heading))).ravel()
    share = abs(normal @ heading) / np.linalg.norm(heading)
    margin = float(ca.evalf(chart.margin(ca.SX(center), frame.heading)))
    if not np.isfinite(normal).all() or (share < 1 - 1e-3 and margin < 0):
        found.error(
            "TS225",
            f"the tool does not start over the part of {frame.surface_name!r} that frame "
            f"{frame.name!r} follows",
            loaded.span(("robot", "start")),
            "start over the face of a box, the side of a cylinder, outside of a sphere",
        )
        return False
    if share < 1 - 1e-3:
        return True
    given = frame.heading is not None
    place = ("frames", frame.name, "heading" if given else "surface")
    found.error(
        "TS225",
        f"frame {frame.name!r} has no x axis where the tool starts: its heading is along the "
        "normal there",
        loaded.span(place),
        "give a heading that lies in the surface, such as heading: [0, 1, 0]",
    )
    return False


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
                loaded.span(("world", name, "stiffness")),
                "raise control.plant_rate, or write `rigid`",
            )


def check_start(context: Context, found: Diagnostics) -> None:
    """Reports objects that the tool is inside of at the start."""
    loaded = context.loaded
    for name, gap in context.start_gaps.items():
        force = -gap * context.compliances[name].stiffness
        if force > TOUCHING:
            found.warning(
                "TS305",
                f"the tool starts {show(-gap, 'mm')} inside {name!r}: the run begins with "
                f"{force:.3g} N of contact",
                loaded.span(("robot", "start")),
                "start above the surface, and approach it with a guarded stage",
            )
