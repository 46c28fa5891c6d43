"""The shapes of the world: one class each, which says all that depends on the shape.

To add one, derive it from `Surface`, or from `BoundedSurface` where it is finite, and `register`
it before the language is imported.
"""

from taskspec.shapes.box import Box
from taskspec.shapes.cylinder import Cylinder
from taskspec.shapes.groove import Groove
from taskspec.shapes.hole import Hole
from taskspec.shapes.mesh import Mesh
from taskspec.shapes.plane import Plane
from taskspec.shapes.registry import (
    SHAPES,
    all_shapes,
    register,
    size_keys,
    tool_shapes,
    with_size,
)
from taskspec.shapes.slot import Slot
from taskspec.shapes.sphere import Sphere
from taskspec.shapes.surface import (
    BoundedSurface,
    Geom,
    SizeKey,
    Surface,
    SurfaceChart,
    ToolEnd,
    WholeShape,
)

for _kind in (Plane, Box, Cylinder, Sphere, Hole, Slot, Groove, Mesh):
    register(_kind)

__all__ = [
    "SHAPES",
    "BoundedSurface",
    "Box",
    "Cylinder",
    "Geom",
    "Groove",
    "Hole",
    "Mesh",
    "Plane",
    "SizeKey",
    "Slot",
    "Sphere",
    "Surface",
    "SurfaceChart",
    "ToolEnd",
    "WholeShape",
    "all_shapes",
    "register",
    "size_keys",
    "tool_shapes",
    "with_size",
]
