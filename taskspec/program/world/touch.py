"""Contact of a flat tool with a shape by its whole surface: depth, normal, point, their rates.

One resultant contact a patch, as the plant has it: with the depth D of the tool in the shape the
contact's energy is k D^2/2. D comes from support functions (`taskspec.shapes.overlap`); with l from
the tip to the tool's support point and n the shape's normal there,

    dD = -n.(dp + dtheta x l),
    dn = T (T^T (H_t + H_s) T)^-1 T^T w,    w = dp + dtheta x l + H_t (dtheta x n),
    dl = dtheta x l + H_t (dtheta x n) - H_t dn,

T two directions across n, H the second derivatives of both support functions. On a plane n stays.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec.native.kernel import vector
from taskspec.robot.types import ToolGeometry
from taskspec.shapes import Plane, Surface, overlap
from taskspec.shapes.plate import CutPlate
from taskspec.shapes.solid import half_sizes, rounding, touched_whole

Vector = NDArray[np.float64]

#: The sine of how far a face, an edge or a side may lean and yet lie flat, once it is pressed: of a
#: tool that is held, 1 deg; of one that yields in turning what is nearest does.
FLAT, _NEAREST = float(np.sin(np.deg2rad(1.0))), float(np.sqrt(0.5))


@dataclass(frozen=True, slots=True)
class Touch:
    """The contact of a tool with a shape, world axes.

    Attributes:
        depth: [m], negative where it is off.
        normal: (3,) outward unit normal of the shape.
        lever: (3,) from the tip to the tool's point [m].
        tool_bend, shape_bend: (3, 3) second derivatives of the support functions [m]; that of a
            plane None.
        spin: lever of the friction that resists being turned about the normal [m].
    """

    depth: float
    normal: Vector
    lever: Vector
    tool_bend: Vector
    shape_bend: Vector | None
    spin: float

    @property
    def way(self) -> Vector:
        """(6,) rate of the depth per twist of the tip."""
        return -np.concatenate([self.normal, np.cross(self.lever, self.normal)])

    def turned(self, A: Vector) -> Touch:
        """The same in axes that a rotation (3, 3) leads to."""
        bend = None if self.shape_bend is None else A @ self.shape_bend @ A.T
        return replace(
            self,
            normal=A @ self.normal,
            lever=A @ self.lever,
            tool_bend=A @ self.tool_bend @ A.T,
            shape_bend=bend,
        )

    def turning(self) -> tuple[Vector, Vector]:
        """(3, 6) rates of the normal, and of the lever [m], per twist of the tip.

        They are those of a tool that has been brought to the surface.
        """
        S, N = _skew(self.lever), _skew(self.normal)
        about = np.hstack([np.zeros((3, 3)), -S - self.tool_bend @ N])
        moved = about + np.hstack([np.eye(3), np.zeros((3, 3))])
        turned = np.zeros((3, 6))
        if self.shape_bend is not None:
            T = np.linalg.svd(self.normal[None, :])[2][1:]
            M = T @ (self.tool_bend + self.shape_bend) @ T.T
            turned = T.T @ np.linalg.solve(M, T @ moved)
        return turned, about - self.tool_bend @ turned

    def bending(self) -> Vector:
        """(6, 6) second derivative of the depth by the tip's pose: rate of `way` per twist."""
        turned, lever = self.turning()
        moment = _skew(self.lever) @ turned - _skew(self.normal) @ lever
        return -np.vstack([turned, moment])


class WholeTool:
    """A tool that touches with its whole surface.

    Args:
        geometry: of it.
    """

    def __init__(self, geometry: ToolGeometry) -> None:
        sizes = half_sizes(geometry.solid)
        assert sizes is not None
        self._kind, self._half = sizes
        self._middle = np.array([0.0, 0.0, geometry.middle])
        self._rounding = rounding(self._half)

    def numbers(self, p: Vector, R: Vector) -> Vector:
        """(17,) as `overlap` takes them, of a tip pose (3,), (3, 3)."""
        center = p + R @ self._middle
        return _numbers(self._kind, self._half, self._rounding, center, R)

    def touch(self, surface: Surface, p: Vector, R: Vector) -> Touch:
        """With a shape, whose cut counts for nothing, at a tip pose (3,), (3, 3)."""
        tool, work = self.numbers(p, R), np.zeros(overlap.WORK)
        if isinstance(surface, Plane | CutPlate):
            n = np.ascontiguousarray(surface.rotation[:, 2])
            shape = None
            reach = farthest(tool, -n)[0]
            depth = reach + float(n @ surface.origin) - overlap.bulge(vector(tool))
        else:
            shape = solid_numbers(surface)
            depth = overlap.overlap(vector(tool), vector(shape), np.inf, vector(work))
            n = work[:3].copy()
        point, bend = _curved(tool, -1.0, n)
        return Touch(
            depth=depth,
            normal=n,
            lever=point - p,
            tool_bend=bend,
            shape_bend=None if shape is None else _curved(shape, 1.0, n)[1],
            spin=float(farthest(tool, -n)[1][3]),
        )

    def lever(self, R: Vector, normal: Vector) -> Vector:
        """(3,) from the tip to its farthest point against a normal, of what nearly lies flat."""
        u = _snapped(self._kind, R.T @ -normal, FLAT)
        return np.asarray(R @ farthest(self.numbers(np.zeros(3), np.eye(3)), u)[1][:3])

    def laid(self, surface: Surface, p: Vector, R: Vector, turns: Vector) -> Touch:
        """The same once what nearly lies flat does so: the tool turned about its tip.

        Args:
            surface: of the shape.
            p, R: (3,), (3, 3) pose of the tip.
            turns: (3, k) unit axes, across each other, about which the tool yields.
        """
        if turns.size:
            w = self._leans(surface, p, R, _NEAREST)
            R = pin.exp3(turns @ (turns.T @ w)) @ R
        return self.touch(surface, p, pin.exp3(self._leans(surface, p, R, FLAT)) @ R)

    def _leans(self, surface: Surface, p: Vector, R: Vector, most: float) -> Vector:
        """(3,) the least turn after which what leans by less than a sine lies flat [rad]."""
        flat = n = self.touch(surface, p, R).normal
        sizes = half_sizes(surface)
        if sizes is not None:
            flat = surface.rotation @ _snapped(sizes[0], surface.rotation.T @ n, most)
        u = R @ _snapped(self._kind, R.T @ -n, most)
        across = np.cross(u, -flat)
        sine, cosine = float(np.linalg.norm(across)), float(u @ -flat)
        return across if sine == 0.0 else across * (np.arctan2(sine, cosine) / sine)


def whole_tool(geometry: ToolGeometry, surface: Surface) -> WholeTool | None:
    """The tool if it touches a shape with its whole surface; None where it does with spheres."""
    return WholeTool(geometry) if geometry.flat and touched_whole(surface) else None


def solid_numbers(surface: Surface) -> Vector:
    """(17,) numbers of a ball, a cylinder or a box, world axes."""
    sizes = half_sizes(surface)
    assert sizes is not None
    kind, half = sizes
    return _numbers(kind, half, overlap.LEAST_ROUNDING, surface.origin, surface.rotation)


def farthest(solid: Vector, u: Vector) -> tuple[float, Vector]:
    """h(u) of a solid (17,) along a direction (3,), its support point and its lever (4,) [m]."""
    (x, y, z), at = u.tolist(), np.zeros(4)
    return overlap.support(vector(solid), x, y, z, vector(at)), at


def _numbers(
    kind: int, half: tuple[float, float, float], eps: float, center: Vector, R: Vector
) -> Vector:
    return np.array([*center, *R.T.ravel(), kind, *half, eps], dtype=np.float64)


def _curved(solid: Vector, sign: float, n: Vector) -> tuple[Vector, Vector]:
    """Support point (3,) and second derivative (3, 3) of a solid along sign n."""
    g = np.zeros(9)
    overlap.curved(vector(solid), sign, vector(n), vector(g))
    xx, xy, xz, yy, yz, zz = g[3:]
    return sign * g[:3], np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _snapped(kind: int, u: Vector, most: float) -> Vector:
    """A direction (3,) of a solid's own axes, exactly across or along what it nearly is."""
    u = u.copy()
    if kind in (overlap.BALL, overlap.CAP):
        return u
    if kind == overlap.BOX:
        u[np.abs(u) < most * np.abs(u).max()] = 0.0
    elif np.linalg.norm(u[:2]) < most:
        u[:2] = 0.0
    elif abs(u[2]) < most:
        u[2] = 0.0
    return np.asarray(u / np.linalg.norm(u))


def _skew(v: Vector) -> Vector:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
