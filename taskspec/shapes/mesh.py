"""The convex mesh: a part as a file of triangles has it."""

from __future__ import annotations

import math
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from taskspec.deferred import ca, np
from taskspec.deferred_methods import dataclass
from taskspec.missing import MissingLibraryError, command_for, library, require
from taskspec.shapes.surface import Geom, SizeKey, Surface, SurfaceChart

if TYPE_CHECKING:
    from collections.abc import Mapping

    from taskspec.shapes.surface import Numbers, Vector

UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": 0.0254}
"""What a number of a mesh's file may mean [m]."""
SUFFIXES = (".stl", ".obj")
"""Endings of the files that are read."""
MOST_FACETS = 1500
"""Facets of a mesh at most: each tick evaluates all of them."""
_MOST_TRIANGLES = 100_000
_COARSER = "export it coarser: a chord of 0.1 mm is enough for most parts"
#: How deep below its convex hull a surface may lie, as a share of its extent: rounding of a file.
_FLUSH = 1e-4
#: Facets whose normals differ by less are one [rad], those that differ by less are one smooth part.
_COPLANAR, _SMOOTH = 1e-4, math.radians(30.0)
#: Beyond a facet that is no part of what a frame follows [m].
_NO_PART = 1e3


class MeshError(Exception):
    """A mesh that cannot be touched.

    Attributes:
        hint: how to put it right.
    """

    def __init__(self, message: str, hint: str) -> None:
        super().__init__(message)
        self.hint = hint


@dataclass(frozen=True, eq=False)
class ConvexBody:
    """A convex polyhedron.

    Attributes:
        corners: (n, 3) [m].
        triangles: (m, 3) numbers of corners, counterclockwise from outside.
        normals: (k, 3) outward unit normals of its facets.
        offsets: (k,) distances of their planes from the origin, along the normals [m].
        parts: (k,) the smooth part of the surface that each is of.
        edges: (e, 4) of sharp edges: both ends, both facets.
        blend: height over which normals of a smooth part blend [m].
    """

    corners: Vector
    triangles: Numbers
    normals: Vector
    offsets: Vector
    parts: Numbers
    edges: Numbers
    blend: float


@lru_cache(maxsize=16)
def read(path: str, changed: int, unit: str) -> ConvexBody:  # noqa: ARG001
    """The body in a file.

    Args:
        path: of the file.
        changed: when that was [ns].
        unit: of its numbers.

    Raises:
        MeshError: it cannot be read, or is not a closed convex body of few facets.
    """
    try:
        require("trimesh", "a mesh", "scipy")
        trimesh = library("trimesh", "a mesh")
    except MissingLibraryError as error:
        raise MeshError(str(error), command_for("trimesh")) from None
    try:
        mesh = trimesh.load_mesh(path)
    except Exception as error:
        # Whatever its readers stumble over.
        raise MeshError(f"it cannot be read: {error}", "save it anew as STL or OBJ") from None
    return convex_body(np.asarray(mesh.vertices) * UNITS[unit], np.asarray(mesh.faces))


def convex_body(corners: Vector, triangles: Numbers) -> ConvexBody:
    """The body of a closed surface.

    Args:
        corners: (n, 3) [m].
        triangles: (m, 3) numbers of corners.

    Raises:
        MeshError: it is not closed, not convex, or has too many facets.
    """
    import trimesh

    if not len(triangles) or not np.isfinite(corners).all():
        raise MeshError("it has no triangles of finite size", "export the part as a solid")
    if len(triangles) > _MOST_TRIANGLES:
        message = f"it has {len(triangles)} triangles, more than {_MOST_TRIANGLES}"
        raise MeshError(message, _COARSER)
    mesh = trimesh.Trimesh(corners, triangles)
    if not mesh.is_watertight:
        _, count = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
        raise MeshError(
            f"it is not closed: {int(np.sum(count != 2))} of its edges do not join two triangles",
            "export the part as a closed solid",
        )
    extent = float(mesh.extents.max())
    first, second, third = np.swapaxes(mesh.triangles, 0, 1)
    volume = abs(float(np.sum(first * np.cross(second, third)))) / 6
    if not volume > (_FLUSH * extent) ** 3:
        raise MeshError("it has no volume", "export the part as a closed solid")
    hull = mesh.convex_hull
    normals, offsets, facet_of = _facets(hull)
    share = f"its volume is {100 * volume / hull.volume:.3g} % of its convex hull's"
    if len(normals) > MOST_FACETS:
        # Of so many facets how deep the surface lies takes long; a part that is convex is all hull.
        also = f", and {share}" if volume < (1 - _FLUSH) * hull.volume else ""
        message = f"it has {len(normals)} facets, more than {MOST_FACETS}{also}"
        raise MeshError(message, _COARSER)
    halfway = mesh.vertices[mesh.edges_unique].mean(axis=1)
    on = np.vstack([mesh.vertices, halfway, mesh.triangles_center])
    pieces = np.array_split(on, 1 + len(on) * len(normals) // 10**7)
    deep = max(float(np.min(offsets - each @ normals.T, axis=1).max()) for each in pieces)
    if deep > _FLUSH * extent:
        raise MeshError(
            f"it is not convex: its surface lies up to {1e3 * deep:.3g} mm below its convex hull, "
            f"and {share}",
            "split it into convex parts, one object each; a bowl or a tube is a sphere or a "
            "cylinder with side: inner, a bore is a hole",
        )
    return _body(hull, normals, offsets, facet_of)


def _facets(hull: Any) -> tuple[Vector, Vector, Numbers]:
    """Normals (k, 3), offsets (k,) [m] of a hull's facets, and the facet (m,) of each triangle."""
    facet_of = _joined(len(hull.faces), hull.face_adjacency[hull.face_adjacency_angles < _COPLANAR])
    area = np.zeros((facet_of.max() + 1, 3))
    np.add.at(area, facet_of, hull.face_normals * hull.area_faces[:, None])
    normals = area / np.linalg.norm(area, axis=1)[:, None]
    offsets = np.full(len(normals), -np.inf)
    np.maximum.at(
        offsets, facet_of, np.einsum("ij,ikj->ik", normals[facet_of], hull.triangles).max(1)
    )
    return normals, offsets, facet_of


def _joined(count: int, pairs: Numbers) -> Numbers:
    """(count,) numbers of the groups that pairs (k, 2) make of things."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    found: Numbers = connected_components(links, directed=False)[1]
    return found


def _body(hull: Any, normals: Vector, offsets: Vector, facet_of: Numbers) -> ConvexBody:
    """The body with its smooth parts, sharp edges, and how far normals blend."""
    between = facet_of[hull.face_adjacency]
    apart = between[:, 0] != between[:, 1]
    between, ends = between[apart], hull.face_adjacency_edges[apart]
    n, m = normals[between[:, 0]], normals[between[:, 1]]
    angles = np.arccos(np.clip(np.sum(n * m, axis=1), -1.0, 1.0))
    smooth = angles < _SMOOTH
    parts = _joined(len(normals), between[smooth])
    centers = np.zeros_like(normals)
    area = np.zeros(len(normals))
    np.add.at(centers, facet_of, hull.triangles_center * hull.area_faces[:, None])
    np.add.at(area, facet_of, hull.area_faces)
    centers /= area[:, None]
    steps = np.linalg.norm(centers[between[:, 0]] - centers[between[:, 1]], axis=1)
    # Over facets of a radius of curvature R weights exp(-R a^2 / (2 blend)) of the angle a to each
    # have a deviation of 0.7 of that between two, from which on their sum has hardly a ripple.
    blend = float(np.mean((steps * angles)[smooth])) / 2 if smooth.any() else 1e-6
    edges = np.hstack([ends[~smooth], between[~smooth]])
    return ConvexBody(
        np.array(hull.vertices), np.array(hull.faces, dtype=np.int_), normals, offsets, parts,
        edges, blend,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Mesh(Surface):
    """A convex part, in the axes of its file.

    Attributes:
        body: it.
    """

    body: ConvexBody

    name = "mesh"
    keys = (
        SizeKey(
            "file",
            "File of a mesh",
            text=True,
            description="STL or OBJ, its path from the task file; a closed convex part",
            example="part.stl",
            shown=("part.stl",),
        ),
        SizeKey(
            "unit",
            "Unit of a mesh's numbers",
            words=tuple(UNITS),
            description="What the numbers of the file are in: it does not say",
            example="mm",
            shown=("mm",),
        ),
    )
    remark = "a mesh is a closed convex part of a file"
    start_over = "over a smooth part of a mesh"
    parts = "smooth parts"
    face_size = 1

    @classmethod
    def placed(cls, origin: Vector, rotation: Vector, sizes: Mapping[str, Any]) -> Surface:
        """The part that a file holds.

        Raises:
            MeshError: it cannot be touched.
        """
        path = sizes["file"]
        return cls(origin, rotation, read(path, Path(path).stat().st_mtime_ns, sizes["unit"]))

    @classmethod
    def fixed(cls, data: Mapping[str, Any]) -> str:  # noqa: ARG003
        """It is held where it is."""
        return "held where it is"

    @cached_property
    def _sharp_corners(self) -> list[tuple[Vector, Vector]]:
        """Corners (3,) where sharp edges end [m], and directions (k, 3) of these out of them."""
        edges, corners = self.body.edges[:, :2], self.body.corners
        found = []
        for corner in np.unique(edges):
            others = np.concatenate(
                [edges[edges[:, 0] == corner, 1], edges[edges[:, 1] == corner, 0]]
            )
            if len(others) > 2:
                found.append((corners[corner], corners[others] - corners[corner]))
        return found

    def height(self, x: ca.SX) -> ca.SX:
        """Distance [m] from the nearest facet, sharp edge or corner.

        Of a smooth edge that of its facets.
        """
        body = self.body
        found = ca.mmax(ca.DM(body.normals) @ x - ca.DM(body.offsets))
        for first, second, a, b in body.edges:
            n, m, start = body.normals[a], body.normals[b], body.corners[first]
            along = body.corners[second] - start
            along = along / np.linalg.norm(along)
            c = float(n @ m)
            off = x - ca.DM(start)
            off = off - ca.dot(ca.DM(along), off) * ca.DM(along)
            over = ca.logic_and(
                ca.dot(ca.DM(m - c * n), off) > 0, ca.dot(ca.DM(n - c * m), off) > 0
            )
            found = ca.if_else(over, ca.fmax(found, ca.sqrt(ca.sumsqr(off) + 1e-30)), found)
        for corner, ways in self._sharp_corners:
            off = x - ca.DM(corner)
            over = ca.mmax(ca.DM(ways) @ off) < 0
            found = ca.if_else(over, ca.fmax(found, ca.sqrt(ca.sumsqr(off) + 1e-30)), found)
        return found

    def chart(self, face: ca.SX | None = None) -> SurfaceChart:
        """The smooth part that the number describes."""
        assert face is not None
        return MeshPart(self, face)

    def face_at(self, point: ca.SX) -> ca.SX:
        """(1,) number of the smooth part that is nearest."""
        heights = ca.DM(self.body.normals) @ self.local(point) - ca.DM(self.body.offsets)
        found, most = ca.SX(int(self.body.parts[0])), heights[0]
        for i, part in enumerate(self.body.parts[1:], 1):
            found = ca.if_else(heights[i] > most, int(part), found)
            most = ca.fmax(most, heights[i])
        return found

    def geom(self) -> Geom:
        """A mesh of MuJoCo."""
        body = self.body
        return Geom("mesh", (1.0, 1.0, 1.0), corners=body.corners, faces=body.triangles)


@dataclass(frozen=True, eq=False)
class MeshPart(SurfaceChart):
    """A smooth part of a mesh: facets that meet at less than 30 degrees, their normals blended.

    The weight of a facet falls by e with each `blend` that a point is higher over another one.

    Attributes:
        mesh: of which it is a part.
        part: its number.
    """

    mesh: Mesh
    part: ca.SX

    def _heights(self, point: ca.SX) -> tuple[ca.SX, ca.SX]:
        """(k,) heights [m] over all facets, and over those of the part, others far below."""
        body = self.mesh.body
        heights = ca.DM(body.normals) @ self.mesh.local(point) - ca.DM(body.offsets)
        return heights, self._of(heights, on=True)

    def _of(self, heights: ca.SX, *, on: bool) -> ca.SX:
        """Heights (k,) of the facets of the part, or of the others; the rest is far below."""
        number = {int(part): self.part == int(part) for part in self.mesh.body.parts}
        chosen = []
        for part, h in zip(self.mesh.body.parts, ca.vertsplit(heights), strict=True):
            own, other = (h, -_NO_PART) if on else (-_NO_PART, h)
            chosen.append(ca.if_else(number[int(part)], own, other))
        return ca.vertcat(*chosen)

    def _blended(self, heights: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Mean normal (3,) of facets, own axes, of heights (k,), and its change (3, 3) [1/m]."""
        N, blend = self.mesh.body.normals, self.mesh.body.blend
        weights = ca.exp((heights - ca.mmax(heights)) / blend)
        weights = weights / ca.sum1(weights)
        mean = ca.DM(N.T) @ weights
        rows, columns = np.triu_indices(3)
        squares = ca.DM((N[:, rows] * N[:, columns]).T) @ weights
        change = ca.SX(3, 3)
        for k, (i, j) in enumerate(zip(rows.tolist(), columns.tolist(), strict=True)):
            change[i, j] = change[j, i] = (squares[k] - mean[i] * mean[j]) / blend
        return mean, change

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance [m] from the nearest facet of the part, continued beyond its edges."""
        return ca.mmax(self._heights(point)[1])

    def normal(self, point: ca.SX) -> ca.SX:
        """Outward unit normal (3,), world, blended."""
        return ca.DM(self.mesh.rotation) @ _unit(self._blended(self._heights(point)[1])[0])

    def numbers(self, point: ca.SX) -> ca.SX:
        """(16,) of `MeshTangent`."""
        R = ca.DM(self.mesh.rotation)
        _, own = self._heights(point)
        mean, change = self._blended(own)
        return ca.vertcat(point, R @ mean, ca.vec(R @ change @ R.T), ca.mmax(own))

    def near(self, numbers: ca.SX) -> SurfaceChart:
        """The part about a point."""
        return MeshTangent(self, numbers)

    def own_x(self) -> ca.SX:
        """The x axis of the file (3,), world."""
        return ca.SX(ca.DM(self.mesh.rotation[:, 0]))

    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:
        """Positive on the part: distance [m] of the foot from the planes of other parts."""
        heights, own = self._heights(point)
        n = _unit(self._blended(own)[0])
        defined = self._away(ca.DM(self.mesh.rotation) @ n, heading)
        if not self.mesh.body.parts.any():
            return defined
        below = heights - ca.mmax(own) * (ca.DM(self.mesh.body.normals) @ n)
        return ca.fmin(defined, -ca.mmax(self._of(below, on=False)))


@dataclass(frozen=True, eq=False)
class MeshTangent(SurfaceChart):
    """A smooth part about a point: values and slopes of all that a frame goes by are its there.

    So no tick differentiates all facets.

    Attributes:
        around: the part.
        given: (16,) the point [m], the mean normal there, its change [1/m] and the distance [m].
    """

    around: MeshPart
    given: ca.SX

    def distance(self, point: ca.SX) -> ca.SX:
        """Distance [m] from the tangent plane."""
        return self.given[15] + ca.dot(_unit(self.given[3:6]), point - self.given[:3])

    def normal(self, point: ca.SX) -> ca.SX:
        """Outward unit normal (3,), world."""
        change = ca.reshape(self.given[6:15], 3, 3)
        return _unit(self.given[3:6] + change @ (point - self.given[:3]))

    def own_x(self) -> ca.SX:
        """The x axis of the file (3,), world."""
        return self.around.own_x()

    def margin(self, point: ca.SX, heading: Vector | None) -> ca.SX:
        """That of the part."""
        return self.around.margin(point, heading)


def _unit(v: ca.SX) -> ca.SX:
    return v / ca.sqrt(ca.sumsqr(v) + 1e-30)
