"""Types of fields that several models share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from taskspec.spec.parse_context import ParseContext
from taskspec.spec.quantities import Entries
from taskspec.spec.words import NameReference
from taskspec.text.codes import register
from taskspec.text.units import ANGLE, LENGTH

register({"TS123": "an unknown object"})

MECHANISMS = ("hinge", "slide", "screw")
"""Kinds of objects that the robot moves by a handle."""

EXACT = "exact "
"""Begins the kind of an equation that holds exactly."""
SPRUNG = ("equation", "rotation equation", "joint equation")
"""Kinds of equations that a spring keeps."""
EQUATIONS = (*SPRUNG, *(EXACT + kind for kind in SPRUNG))
"""Kinds of constraint equations."""

XYZ = Annotated[tuple[float, float, float], Entries((LENGTH,) * 3)]
RPY = Annotated[tuple[float, float, float], Entries((ANGLE,) * 3)]


def _other_than_a_frame(name: str, context: ParseContext) -> str:
    """What to write instead of the name of an object that is no frame."""
    if name in context.of_kind(*EQUATIONS):
        return f"{name!r} is an equation, which has no axes; name a frame"
    return ""


def _other_than_a_surface(name: str, context: ParseContext) -> str:
    """What to write instead of the name of an object that has no surface."""
    kind = context.objects.get(name)
    if kind == "bushing":
        return f"a bushing is no surface; a stage's frame may be {name!r}"
    if kind in MECHANISMS:
        return f"it is a {kind}; a stage's frame may be {name!r} or '{name}.handle'"
    return "an equation is no surface; write a shape" if kind is not None else ""


def _other_than_a_contact(name: str, context: ParseContext) -> str:
    """What to write instead of the name of an object that no force is pressed on."""
    if context.objects.get(name) in MECHANISMS:
        return f"what is held returns forces by itself: robot.grasp: {name}.handle"
    if context.objects.get(name) == "bushing":
        return "a bushing returns forces on all axes by itself: leave 'contact' out"
    return "forces along equations stand under 'constraints'" if name in context.objects else ""


OWN_FRAMES = ("world", "tool")
"""Frames of every task."""
FrameName = Annotated[
    str,
    NameReference(
        lambda r: r.frames, "frame", "TS122", instead=_other_than_a_frame, always=OWN_FRAMES
    ),
]


def _surface_name(instead: Callable[[str, ParseContext], str]) -> NameReference:
    return NameReference(
        lambda r: r.of_kind("shape"),
        "object with a surface",
        "TS123",
        "objects with a surface",
        "'{}' is no object with a surface",
        instead,
    )


SurfaceName = Annotated[str, _surface_name(_other_than_a_surface)]
ContactName = Annotated[str, _surface_name(_other_than_a_contact)]
MECHANISM_NAME = NameReference(
    lambda r: r.of_kind(*MECHANISMS),
    "mechanism",
    "TS123",
    unfit="'{}' is no mechanism",
)
MechanismName = Annotated[str, MECHANISM_NAME]
ObjectName = Annotated[str, NameReference(lambda r: r.objects, "object", "TS123")]
