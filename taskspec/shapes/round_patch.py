"""Parts of spheres and cylinders with edges: panels from outside, bowls and tubes from within.

A panel is what a plane cuts off: a cap of a sphere about its own z, a segment of a cylinder about
its own x. A bowl or tube is a wall about a cavity, which opens towards the same axis; its inside
has the radius.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.shapes.surface import (
    Geom,
    SizeKey,
    Surface,
    SurfaceChart,
    WholeShape,
    banded,
    outside,
)
from taskspec.text.units import ANGLE

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from taskspec.shapes.surface import Vector

#: How thick the wall of a bowl or tube is where the file does not say [m].
THICKNESS = 0.01
#: Depth below the centre of a bowl, as a share of its radius, down to which its frame leans less
#: than its normals, which all meet in the centre.
_ABOUT_CENTER = 0.5
#: Edges of what is hollow count from half of where they are off the middle on, all from 3/4 on.
_EDGE, _EDGE_SLOPE = 3.0, 4.0
#: How far the whole shape of a sphere bends [rad]: that is a closed one.
_AROUND = 2 * math.pi
#: Corners of a drawn circle.
_ROUND = 64


PATCH_KEYS = (
    SizeKey(
        "side",
        "Side that is touched",
        words=("outer", "inner"),
        description="Of a sphere or a cylinder; inner is the inside of a bowl or of a tube",
        shown=("inner",),
    ),
    SizeKey(
        "arc",
        "Angle from edge to edge",
        dimension=ANGLE,
        description="Of a part of a sphere, about its z, or of a cylinder, about its x: from "
        "outside it bulges there, from within it opens there. All of it by default, but of a "
        "sphere from within half of it",
        example="60 deg",
        shown=("60 deg",),
        most=_AROUND,
    ),
    SizeKey(
        "thickness",
        "Thickness of a wall",
        description="Of what is touched from within; 10 mm by default",
        example="5 mm",
        shown=("5 mm",),
    ),
)
"""Sizes of spheres and cylinders that make parts of them."""


def patch(
    origin: Vector,
    rotation: Vector,
    sizes: Mapping[str, Any],
    solid: type[Surface],
    panel: type[RoundPatch],
    hollow: type[RoundPatch],
    arc: float,
) -> Surface:
    """What sizes by key make of a solid, its panel and its hollow, by default of an arc [rad]."""
    given = dict(sizes)
    if given.pop("side", "outer") == "inner":
        return hollow(origin, rotation, **{"arc": arc} | given)
    return (panel if "arc" in given else solid)(origin, rotation, **given)


def fixed_part(data: Mapping[str, Any]) -> str:
    """Why what sizes in a file make is fixed, as of `Surface.fixed`."""
    part = data.get("side") == "inner" or "arc" in data
    return "hollow or a part of one here" if part else ""


@dataclass(frozen=True, eq=False)
class RoundPatch(Surface):
    """A part of a sphere or a cylinder.

    Attributes:
        radius: [m].
        arc: from edge to edge, about the centre or the axis [rad].
        within: whether it is touched from within.
        middle: the axis of its own that goes through the middle of the patch, as a number.
        straight: the axis of its own along which it is straight; None for a sphere.
    """

    radius: float
    arc: float

    within: ClassVar[bool]
    middle: ClassVar[int]
    straight: ClassVar[int | None] = None

    @property
    def half(self) -> float:
        """From the middle to an edge [rad]."""
        return self.arc / 2

    @property
    def open(self) -> bool:
        """Whether it is a cavity that one sees all of from its centre or axis, and from above."""
        return self.within and self.arc <= math.pi

    @property
    def end(self) -> float:
        """Half its length along what is straight [m]."""
        return math.inf

    def radial(self, x: ca.SX) -> ca.SX:
        """A point (3,) in own coordinates less what is along the straight axis."""
        return ca.vertcat(*(0 if i == self.straight else x[i] for i in range(3)))

    def core(self, point: ca.SX) -> ca.SX:
        """The centre, or the point of the axis nearest to a world point (3,), world [m]."""
        x = self.local(point)
        return point - ca.DM(self.rotation) @ self.radial(x)

    def off_middle(self, x: ca.SX) -> ca.SX:
        """Distance [m] of a point (3,) in own coordinates from the axis through the middle."""
        others = [x[i] ** 2 for i in range(3) if i not in (self.middle, self.straight)]
        return ca.sqrt(sum(others, ca.SX(1e-30)))

    def below(self, x: ca.SX) -> ca.SX:
        """Where the frame at a point (3,), own axes, has its normal from, less what is straight.

        That is the point itself, but below the centre of an open cavity: there all normals meet,
        and one that comes in from above looks at the middle.
        """
        y = self.radial(x)
        if self.open:
            share = self.off_middle(x) / (_EDGE / _EDGE_SLOPE * self.radius * math.sin(self.half))
            low = -_ABOUT_CENTER * self.radius * ca.fmax(1 - share**2, 0)
            y[self.middle] = ca.fmin(y[self.middle], low)
        return y

    def normal(self, x: ca.SX) -> ca.SX:
        """Outward unit normal (3,) of the round side at the foot of a point (3,), own axes."""
        y = self.below(x)
        return (-1 if self.within else 1) * y / ca.sqrt(ca.sumsqr(y) + 1e-30)

    def off_round(self, x: ca.SX) -> ca.SX:
        """Distance [m] of a point (3,), own axes, from the whole sphere or cylinder.

        Above the centre of an open cavity it is continued along the normal.
        """
        y, n = self.below(x), self.normal(x)
        off = ca.sqrt(ca.sumsqr(y) + 1e-30) - self.radius
        return (-off if self.within else off) + ca.dot(self.radial(x) - y, n)

    def wall(self, x: ca.SX, thickness: float) -> ca.SX:
        """Distance [m] of a point (3,) from the wall of what is hollow, but for its straight ends.

        In the middle of the cavity it is `off_round`, wherever the edge is.
        """
        off = self.off_middle(x)
        true = _wall(-x[self.middle], off, self.radius, self.half, thickness)
        if not self.open:
            return true
        share = ca.fmax(
            0, ca.fmin(1, _EDGE - _EDGE_SLOPE * off / (self.radius * math.sin(self.half)))
        )
        within = ca.norm_2(self.below(x)) < self.radius
        return ca.if_else(within, true + share * (self.off_round(x) - true), true)

    def chart(self, face: ca.SX | None = None) -> SurfaceChart:  # noqa: ARG002
        """The round side with its edges."""
        return PatchChart(self)

    def gradient(self, point: ca.SX) -> ca.SX:
        """Outward normal (3,); anywhere within an open cavity that of its inside."""
        found = super().gradient(point)
        if not self.open:
            return found
        x = self.local(point)
        within = ca.norm_2(self.below(x)) < self.radius
        if self.straight is not None:
            within = ca.logic_and(within, ca.fabs(x[self.straight]) < self.end)
        return ca.if_else(within, self.chart().normal(point), found)

    def geom(self) -> Geom:
        """The geom that contacts are reported of; it touches nothing itself."""
        return Geom("sphere", (1e-3, 0.0, 0.0))

    @abstractmethod
    def drawn(self) -> Sequence[Vector]:
        """Polylines (n, 3) [m], an even number: a picture spans a band between each two."""

    def visible_geom(self, center: Vector, half: Vector) -> Geom:  # noqa: ARG002
        """All of it."""
        return banded(self.drawn())


@dataclass(frozen=True, eq=False)
class PatchChart(SurfaceChart):
    """The round side of a patch, continued beyond its edges."""

    patch: RoundPatch

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance [m] from the sphere or cylinder, of a concave one along the normal."""
        return self.patch.off_round(self.patch.local(point))

    def normal(self, point: ca.SX) -> ca.SX:
        """Outward unit normal (3,), world: towards the centre or axis of what is concave."""
        return ca.DM(self.patch.rotation) @ self.patch.normal(self.patch.local(point))

    def own_x(self) -> ca.SX:
        """The x axis of a sphere, the axis of a cylinder (3,), world."""
        column = 0 if self.patch.straight is None else self.patch.straight
        return ca.SX(ca.DM(self.patch.rotation[:, column]))

    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:
        """Positive between its edges and ends, where x is defined."""
        patch = self.patch
        x = patch.local(point)
        edge = patch.radius * (patch.normal(x)[patch.middle] - math.cos(patch.half))
        found = self.away_from_pole(point, heading)
        if patch.arc < _AROUND:
            found = ca.fmin(found, edge)
        if patch.within and not patch.open:
            found = ca.fmin(found, ca.norm_2(patch.radial(x)) - 1e-3 * patch.radius)
        if patch.straight is None:
            return found
        return ca.fmin(found, patch.end - ca.fabs(x[patch.straight]))


@dataclass(frozen=True, eq=False)
class SphereCap(RoundPatch):
    """What a plane cuts off a sphere, about its own z: a panel that bends both ways."""

    name = "sphere"
    within = False
    middle = 2

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from the round side, its rim or the flat side."""
        return _segment(x[2], self.off_middle(x), self.radius, self.half)

    def whole(self) -> WholeShape:
        """The cap as the plant takes it."""
        return WholeShape("cap", (self.radius, self.half, self.radius))

    def drawn(self) -> Sequence[Vector]:
        """Rings from the middle to the rim and to the middle of the flat side."""
        angles = np.linspace(0.0, self.half, _ROUND // 2 + 1)
        flat = [(0.0, self.radius * math.cos(self.half))]
        return _turned(
            [(self.radius * math.sin(a), self.radius * math.cos(a)) for a in angles] + flat
        )


@dataclass(frozen=True, eq=False)
class CylinderSegment(RoundPatch):
    """What a plane along its axis cuts off a cylinder, about its own x: a panel that bends one way.

    Attributes:
        length: along its axis, its own z [m].
    """

    length: float

    name = "cylinder"
    within = False
    middle = 0
    straight = 2

    @property
    def end(self) -> float:
        """Half the length [m]."""
        return self.length / 2

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from the round side, its edges, the flat side or an end."""
        across = _segment(x[0], self.off_middle(x), self.radius, self.half)
        return outside(ca.vertcat(across, ca.fabs(x[2]) - self.end))

    def whole(self) -> WholeShape:
        """The segment as the plant takes it."""
        return WholeShape("segment", (self.radius, self.half, self.end))

    def drawn(self) -> Sequence[Vector]:
        """The arc along the axis, the flat side, and a fan at each end."""
        angles = np.linspace(self.half, -self.half, _ROUND + 1)
        arc = self.radius * np.column_stack((np.cos(angles), np.sin(angles)))
        low, high = (np.column_stack((arc, np.full(len(arc), s * self.end))) for s in (-1, 1))
        hubs = [np.tile((line[0] + line[-1]) / 2, (len(line), 1)) for line in (low, high)]
        return [hubs[0], low, low, high, high, hubs[1], high[[0, -1]], low[[0, -1]]]


@dataclass(frozen=True, eq=False)
class Bowl(RoundPatch):
    """A part of a hollow sphere, which opens towards its own z.

    Attributes:
        thickness: of its wall [m].
    """

    thickness: float = THICKNESS

    name = "sphere"
    convex = False
    within = True
    middle = 2

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from the inside, the outside or the rim."""
        return self.wall(x, self.thickness)

    def whole(self) -> WholeShape:
        """The bowl as the plant takes it."""
        return WholeShape("bowl", (self.radius, self.half, self.thickness))

    def drawn(self) -> Sequence[Vector]:
        """Rings from the middle along the inside to the rim and back along the outside."""
        angles = np.linspace(0.0, self.half, _ROUND // 2 + 1)
        outer = self.radius + self.thickness
        rings = [(self.radius * math.sin(a), -self.radius * math.cos(a)) for a in angles]
        rings += [(outer * math.sin(a), -outer * math.cos(a)) for a in angles[::-1]]
        return _turned(rings)


@dataclass(frozen=True, eq=False)
class Tube(RoundPatch):
    """A hollow cylinder about its own z, or a part of one, which opens towards its own x.

    Attributes:
        length: from end to end [m].
        thickness: of its wall [m].
    """

    length: float
    thickness: float = THICKNESS

    name = "cylinder"
    convex = False
    within = True
    middle = 0
    straight = 2

    @property
    def end(self) -> float:
        """Half the length [m]."""
        return self.length / 2

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from the inside, the outside, an edge or an end."""
        across = self.wall(x, self.thickness)
        return outside(ca.vertcat(across, ca.fabs(x[2]) - self.end))

    def whole(self) -> WholeShape:
        """The tube as the plant takes it."""
        return WholeShape("tube", (self.radius, self.half, self.thickness, self.length))

    def drawn(self) -> Sequence[Vector]:
        """Inside, ends and outside, around the axis, and both edges."""
        angles = math.pi + np.linspace(self.half, -self.half, _ROUND + 1)
        around = np.column_stack((np.cos(angles), np.sin(angles)))
        z, inner, outer = self.end, self.radius, self.radius + self.thickness
        ring = [(inner, z), (inner, -z), (outer, -z), (outer, z), (inner, z)]
        lines = [np.column_stack((r * around, np.full(len(around), h))) for r, h in ring]
        edges = [np.array([line[end] for line in lines[:4]]) for end in (0, -1)]
        quads = [edges[0][[0, 3]], edges[0][[1, 2]], edges[1][[1, 2]], edges[1][[0, 3]]]
        return [line for pair in pairwise(lines) for line in pair] + quads


def _segment(along: ca.SX, off: ca.SX, radius: float, half: float) -> ca.SX:
    """Signed distance [m] from what a line cuts off a disc.

    Args:
        along: of a point, along the axis through the middle [m].
        off: from that axis, positive [m].
        radius: [m].
        half: angle from the middle to a corner [rad].
    """
    low, wide = radius * math.cos(half), radius * math.sin(half)
    far = ca.sqrt(along**2 + off**2 + 1e-30)
    arc, chord = far - radius, low - along
    corner = ca.sqrt((along - low) ** 2 + (off - wide) ** 2 + 1e-30)
    over = ca.logic_and(arc > 0, along >= far * math.cos(half))
    under = ca.logic_and(chord > 0, off <= wide)
    within = ca.logic_and(arc <= 0, chord <= 0)
    found = ca.if_else(over, arc, ca.if_else(under, chord, corner))
    return ca.if_else(within, ca.fmax(arc, chord), found)


def _wall(along: ca.SX, off: ca.SX, radius: float, half: float, thickness: float) -> ca.SX:
    """Signed distance [m] from a part of a ring, arguments as of `_segment`."""
    far = ca.sqrt(along**2 + off**2 + 1e-30)
    wall = ca.fmax(radius - far, far - radius - thickness)
    if 2 * half >= _AROUND:
        return wall
    c, s = math.cos(half), math.sin(half)
    on = ca.fmin(ca.fmax(along * c + off * s, radius), radius + thickness)
    edge = ca.sqrt((along - on * c) ** 2 + (off - on * s) ** 2 + 1e-30)
    return ca.if_else(along >= far * c, wall, edge)


def _turned(profile: Sequence[tuple[float, float]]) -> list[Vector]:
    """Bands of what a profile of radius and height [m] becomes as it turns about z."""
    angles = 2 * np.pi * np.arange(_ROUND + 1) / _ROUND
    around = np.column_stack((np.cos(angles), np.sin(angles)))
    lines = [np.column_stack((r * around, np.full(len(around), z))) for r, z in profile]
    return [line for pair in pairwise(lines) for line in pair]
