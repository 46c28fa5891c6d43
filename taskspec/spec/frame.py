"""`frames`: named frames, fixed, following a surface, or tracking a force or a motion."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field

from taskspec.spec.fields import RPY, XYZ, FrameName, SurfaceName
from taskspec.spec.model import Model, complete, mapping
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Constant, DimensionedNumber, EitherQuantity, Entries
from taskspec.spec.words import NameReference, Word
from taskspec.text.codes import register
from taskspec.text.data import Map
from taskspec.text.nodes import pointer
from taskspec.text.units import ANGULAR_VELOCITY, FORCE, FREQUENCY, NUMBER, VELOCITY, Dimension

register(
    {
        "TS208": "frames that are placed in each other in a circle",
        "TS209": "a frame that is both fixed and following",
    }
)

_FIXED = ("parent", "xyz", "rpy")
#: What a frame tracks: the measured force or the motion.
_OF_TRACKING = ("filter", "floor", "turn", "normal")
#: What a frame tracks, and what measures it.
TRACKED: dict[str, Dimension] = {"force": FORCE, "velocity": VELOCITY}


class Frame(Model):
    """A frame: fixed in its parent, or following the tool over a surface.

    Attributes:
        parent: the frame in which it is placed; None for the world.
        xyz: position in the parent [m].
        rpy: orientation in the parent [rad].
        surface: the object over which it follows the tool.
        heading: a direction of the world that is laid on the tangent plane as the x axis.
        estimate: the stage at whose end it is measured: its origin where the tip is then, its z
            against the mean force measured there.
        track: what turns it while a stage is on: the contact force, against which its z is kept,
            or the velocity, along which its x is.
        filter: cutoff of the filter that the force or the velocity passes [Hz].
        floor: the filtered force [N] or velocity [m/s] up to which it keeps its direction; None
            for the default of what it tracks.
        turn: how fast it turns at most [rad/s].
        normal: a direction of the world that is laid across the motion as the z axis.
        point: `origin` moves the control point to the frame's origin.
    """

    noun = "a frame"
    example = "task: {surface: table}"
    parent: FrameName | None = Field(None, title="The frame in which it is placed")
    xyz: XYZ = Field((0.0, 0.0, 0.0), title="Position in the parent", description="[x, y, z]")
    rpy: RPY = Field((0.0, 0.0, 0.0), title="Orientation in the parent")
    surface: SurfaceName | None = Field(
        None, title="Surface", description="The object over which the frame follows the tool"
    )
    heading: Annotated[tuple[float, float, float], Entries((NUMBER,) * 3, nonzero=True)] | None = (
        Field(None, title="Heading", description="A direction laid on the surface as the x axis")
    )
    point: Annotated[Literal["origin"], Word(("origin",), "control point")] | None = Field(
        None, title="Control point", description="origin: the control point is the frame's origin"
    )

    estimate: Annotated[str, NameReference(lambda r: r.stages, "stage", "TS124")] | None = Field(
        None, title="Stage", description="The stage at whose end the frame is measured"
    )

    track: (
        Annotated[Literal["force", "velocity"], Word(tuple(TRACKED), "quantity to track")] | None
    ) = Field(
        None,
        title="What is tracked",
        description="force: z is kept against the contact force; velocity: x along the motion",
    )
    filter: Annotated[float, Constant(FREQUENCY, above=0)] = Field(
        2.0, title="Cutoff of the filter of what is tracked"
    )
    floor: Annotated[DimensionedNumber, EitherQuantity(FORCE, VELOCITY, above=0)] | None = Field(
        None, title="Force or speed below which the frame keeps its direction"
    )
    turn: Annotated[float, Constant(ANGULAR_VELOCITY, above=0)] = Field(
        math.radians(30), title="Greatest rate of turn of the frame"
    )
    normal: Annotated[tuple[float, float, float], Entries((NUMBER,) * 3, nonzero=True)] | None = (
        Field(None, title="Normal", description="A direction laid across the motion as the z axis")
    )

    @classmethod
    def rules(cls, data: Map, context: ParseContext) -> None:
        """Keeps fixed, following, tracking and measured frames apart."""
        if _tracks(data, context):
            return
        fixed = [key for key in _FIXED if key in data]
        other = [key for key in (*_FIXED, "surface", "point") if key in data]
        if "estimate" in data and other:
            context.error(
                "TS209",
                f"a frame that is measured has no '{other[0]}'",
                data.node.key_span(other[0]),
                "its place follows from what the tool feels",
            )
            return
        if "surface" in data and fixed:
            context.error(
                "TS209",
                f"a frame that follows a surface has no '{fixed[0]}'",
                data.node.key_span(fixed[0]),
                "its place follows from the tool's",
            )
        if "surface" in data and "point" in data:
            context.error(
                "TS209",
                "a frame that follows a surface keeps the control point at the tool tip",
                data.node.key_span("point"),
                "leave 'point' out",
            )
        if (
            "heading" in data
            and not data.keys() & {"surface", "estimate", "track"}
            and complete(data, context)
        ):
            context.error(
                "TS026",
                "'heading' belongs to a frame that follows a surface, tracks or is measured",
                data.node.key_span("heading"),
                "add 'surface', or turn a fixed frame by 'rpy'",
            )
        if not data and complete(data, context):
            context.error(
                "TS021",
                "a frame needs 'parent', 'xyz', 'rpy', 'surface', 'estimate' or 'track'",
                pointer(data.node),
            )


def _tracks(data: Map, context: ParseContext) -> bool:
    """Whether a frame tracks force or motion; reports keys that do not go together."""
    if "track" not in data:
        how = [key for key in _OF_TRACKING if key in data]
        if how and complete(data, context):
            context.error(
                "TS026",
                f"'{how[0]}' belongs to a frame that tracks a "
                + ("velocity" if how[0] == "normal" else "force or a velocity"),
                data.node.key_span(how[0]),
                f"add 'track: {'velocity' if how[0] == 'normal' else 'force'}'",
            )
        return False
    of = str(data["track"])
    other = [key for key in (*_FIXED, "surface", "estimate", "point") if key in data]
    if of == "force" and "normal" in data:
        other.append("normal")
    if other:
        context.error(
            "TS209",
            f"a frame that tracks a {'velocity' if of == 'velocity' else 'force'} has no "
            f"'{other[0]}'",
            data.node.key_span(other[0]),
            "its axes follow from how the tool moves"
            if of == "velocity"
            else "its axes follow from what the tool feels",
        )
    return True


def check_loops(frames: Map, context: ParseContext) -> None:
    """Reports every circle of frames that are placed in each other, once."""
    parents = {name: mapping(frame).get("parent") for name, frame in frames.items()}
    visited: set[object] = set()
    for name in frames:
        trail: dict[str, int] = {}
        step: object = name
        while isinstance(step, str) and step in parents and step not in visited:
            visited.add(step)
            trail[step] = len(trail)
            step = parents[step]
        if isinstance(step, str) and step in trail:
            circle = [str(frame) for frame in trail][trail[step] :]
            text = " in ".join([*circle, circle[0]])
            span = mapping(frames[circle[0]]).node.entries["parent"][1].span
            context.error("TS208", f"frames placed in a circle: {text}", span)
