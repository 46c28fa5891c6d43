"""Types of fields that several models share."""

from __future__ import annotations

from typing import Annotated

from taskspec.spec.quantities import Entries
from taskspec.spec.words import Reference
from taskspec.text.units import ANGLE, LENGTH

XYZ = Annotated[tuple[float, float, float], Entries((LENGTH,) * 3)]
RPY = Annotated[tuple[float, float, float], Entries((ANGLE,) * 3)]
FrameName = Annotated[str, Reference(lambda r: r.frames, "frame", "TS122")]
SurfaceName = Annotated[
    str,
    Reference(
        lambda r: r.of_kind("shape"),
        "object with a surface",
        "TS123",
        "objects with a surface",
        "'{}' is no object with a surface",
    ),
]
MechanismName = Annotated[
    str,
    Reference(
        lambda r: r.of_kind("hinge", "slide", "screw"),
        "mechanism",
        "TS123",
        unfit="'{}' is no mechanism",
    ),
]
ObjectName = Annotated[str, Reference(lambda r: r.objects, "object", "TS123")]
