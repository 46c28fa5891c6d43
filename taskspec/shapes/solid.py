"""Shapes as the numbers that `overlap` and `patches` take: kinds, sizes and rounding."""

from __future__ import annotations

from typing import TYPE_CHECKING

from taskspec.shapes import patches
from taskspec.shapes.box import Box
from taskspec.shapes.cylinder import Cylinder
from taskspec.shapes.overlap import BALL, BOX, CYLINDER, LEAST_ROUNDING, ROUNDED
from taskspec.shapes.plane import Plane
from taskspec.shapes.sphere import Sphere

if TYPE_CHECKING:
    from taskspec.shapes.surface import Surface

_CUTS = {"hole": patches.HOLE, "slot": patches.SLOT, "groove": patches.GROOVE}


def half_sizes(solid: Surface) -> tuple[int, tuple[float, float, float]] | None:
    """Kind and half sizes [m] of a ball, a cylinder or a box; None of other shapes."""
    if isinstance(solid, Sphere):
        return BALL, (solid.radius, solid.radius, solid.radius)
    if isinstance(solid, Cylinder):
        return CYLINDER, (solid.radius, solid.radius, solid.length / 2)
    if isinstance(solid, Box):
        x, y, z = (edge / 2 for edge in solid.size)
        return BOX, (x, y, z)
    return None


def kind_and_sizes(surface: Surface) -> tuple[int, tuple[float, ...]]:
    """Of a shape that is touched whole, as `patches.find` takes them [m, rad]."""
    cut = surface.cut()
    if cut is not None:
        return _CUTS[cut.kind], cut.sizes
    sizes = half_sizes(surface)
    if sizes is None:
        return patches.PLATE, ()
    return sizes[0], (*sizes[1], LEAST_ROUNDING)


def rounding(half: tuple[float, float, float]) -> float:
    """How far the faces of a tool with these half sizes bulge [m]."""
    return max(LEAST_ROUNDING, ROUNDED * max(half[:2]))


def touched_whole(solid: Surface) -> bool:
    """Whether a flat tool touches a shape with its whole surface: all but shapes of others."""
    return isinstance(solid, Plane) or solid.cut() is not None or half_sizes(solid) is not None
