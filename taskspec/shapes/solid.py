"""Shapes as the numbers that `overlap` and `patches` take: kinds, sizes and rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.shapes import patches
from taskspec.shapes.box import Box
from taskspec.shapes.cylinder import Cylinder
from taskspec.shapes.overlap import (
    BALL,
    BOX,
    CAP,
    CYLINDER,
    LEAST_ROUNDING,
    ROUNDED,
    SEGMENT,
)
from taskspec.shapes.plane import Plane
from taskspec.shapes.plate import CutPlate
from taskspec.shapes.sphere import Sphere

if TYPE_CHECKING:
    from taskspec.shapes.surface import Surface

_KINDS = {
    "hole": patches.HOLE, "slot": patches.SLOT, "groove": patches.GROOVE,
    "bowl": patches.BOWL, "tube": patches.TUBE,
}  # fmt: skip
_SOLIDS = {"cap": CAP, "segment": SEGMENT}


def half_sizes(solid: Surface) -> tuple[int, tuple[float, float, float]] | None:
    """Kind and sizes of a solid as `overlap` takes them [m, rad]; None of other shapes."""
    if isinstance(solid, Sphere):
        return BALL, (solid.radius, solid.radius, solid.radius)
    if isinstance(solid, Cylinder):
        return CYLINDER, (solid.radius, solid.radius, solid.length / 2)
    if isinstance(solid, Box):
        x, y, z = (edge / 2 for edge in solid.size)
        return BOX, (x, y, z)
    whole = solid.whole()
    if whole is not None and whole.kind in _SOLIDS:
        first, second, third = whole.sizes
        return _SOLIDS[whole.kind], (first, second, third)
    return None


def kind_and_sizes(surface: Surface) -> tuple[int, tuple[float, ...]]:
    """Of a shape that is touched whole, as `patches.find` takes them [m, rad]."""
    sizes = half_sizes(surface)
    if sizes is not None:
        return sizes[0], (*sizes[1], LEAST_ROUNDING)
    whole = surface.whole()
    return (patches.PLATE, ()) if whole is None else (_KINDS[whole.kind], whole.sizes)


def rounding(half: tuple[float, float, float]) -> float:
    """How far the faces of a tool with these half sizes bulge [m]."""
    return max(LEAST_ROUNDING, ROUNDED * max(half[:2]))


def touched_whole(solid: Surface) -> bool:
    """Whether a flat tool touches a shape with its whole surface."""
    return isinstance(solid, Plane | CutPlate) or half_sizes(solid) is not None
