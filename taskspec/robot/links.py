"""The links of an arm as balls that lie in the shapes of its file: for what they run into.

A capsule is balls in a row, so near that no point of it is more than `_DENT` of its radius outside,
unless it is thinner than a hundredth of its length.
Of a cylinder and a box the balls are those of the capsule within, and points on its edges; of an
ellipsoid the ball within, and points all over it; of a mesh the corners of its convex hull. None is
outside the shape, so what a ball meets, the link meets.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.poses import pose
from taskspec.robot.twin import Twin

Vector = NDArray[np.float64]
Balls = tuple[Vector, Vector]
"""Centres (k, 3) and radii (k,) [m]."""

#: Share of its radius by which a row of balls falls short of a capsule.
_DENT = 0.03
#: Balls in a row at most: what is longer than a hundred times its radius has gaps between them.
_BALLS = 400
#: Points on a rim.
_RIM = 16
#: Points on an ellipsoid; corners of a mesh at most.
_ROUND, _CORNERS = 100, 200


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """The balls of all links that move.

    Attributes:
        names: of the links, in the file.
        link: (k,) number of each ball's link in `names`.
        joint: (k,) Pinocchio's number of the joint that carries it.
        centers: (k, 3) in that joint's axes [m].
        radii: (k,) [m].
    """

    names: tuple[str, ...]
    link: NDArray[np.int64]
    joint: NDArray[np.int64]
    centers: Vector
    radii: Vector

    def at(self, twin: Twin, q: Vector) -> Vector:
        """(k, 3) the centres in the world with the arm at q (n,) [m]."""
        data = twin.place(q)
        found = np.empty_like(self.centers)
        # Balls of one link follow each other.
        begins = [0, *(np.flatnonzero(np.diff(self.joint)) + 1).tolist(), len(found)]
        for begin, end in itertools.pairwise(begins if len(found) else ()):
            at = data.oMi[int(self.joint[begin])]
            found[begin:end] = self.centers[begin:end] @ at.rotation.T + at.translation
        return found


def links_of(
    m: mujoco.MjModel, carried: Sequence[tuple[int, pin.SE3]], tip: int, end: float
) -> Links:
    """The links of an arm that MuJoCo has compiled.

    Args:
        m: arm and tool.
        carried: of each of its bodies, the joint that carries it and its pose there.
        tip: number of the body that is the tool; its frame is the tip's.
        end: how far the tool's end goes back from the tip [m]; that is to touch, and left out.
    """
    names: list[str] = []
    found: list[tuple[int, int, Vector, Vector]] = []
    for g in range(m.ngeom):
        body = int(m.geom_bodyid[g])
        joint, placement = carried[body]
        if joint == 0:
            # What does not move stands where its user has put it.
            continue
        centers, radii = _balls(m, g)
        at = pose(m.geom_pos[g], m.geom_quat[g])
        centers = centers @ at.rotation.T + at.translation
        if body == tip:
            behind = centers[:, 2] + radii < -end
            centers, radii = centers[behind], radii[behind]
        if not len(radii):
            continue
        name = m.body(body).name or f"body {body}"
        if name not in names:
            names.append(name)
        centers = centers @ placement.rotation.T + placement.translation
        found.append((names.index(name), joint, centers, radii))
    return Links(
        tuple(names),
        np.concatenate([np.full(len(r), link) for link, _, _, r in found] or [np.zeros(0, int)]),
        np.concatenate([np.full(len(r), joint) for _, joint, _, r in found] or [np.zeros(0, int)]),
        np.concatenate([c for _, _, c, _ in found] or [np.zeros((0, 3))]),
        np.concatenate([r for _, _, _, r in found] or [np.zeros(0)]),
    )


def _balls(m: mujoco.MjModel, g: int) -> Balls:
    """The balls of a geom, in its own axes."""
    kind, size = mujoco.mjtGeom(int(m.geom_type[g])), m.geom_size[g]
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return np.zeros((1, 3)), size[:1].copy()
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        return _row(float(size[0]), float(size[1]), 2)
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        r, h = float(size[0]), float(size[1])
        turns = np.linspace(0.0, 2 * np.pi, _RIM, endpoint=False)
        rim = np.column_stack([r * np.cos(turns), r * np.sin(turns), np.full(_RIM, h)])
        within = _row(min(r, h), max(h - r, 0.0), 2)
        return _joined(within, _points([*rim, *(rim * (1, 1, -1))]))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        along, least = int(np.argmax(size)), float(np.min(size))
        corners = itertools.product((-1, 1), repeat=3)
        within = _row(least, float(size[along]) - least, along)
        return _joined(within, _points([np.array(end) * size for end in corners]))
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return _joined(_row(float(np.min(size)), 0.0, 0), _points([*(_directions(_ROUND) * size)]))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _points(list(_hull(m, int(m.geom_dataid[g]))))
    return np.zeros((0, 3)), np.zeros(0)


def _row(r: float, half: float, along: int) -> Balls:
    """Balls of radius r from -half to half along an axis."""
    # Between two balls s apart a capsule has r, and they have sqrt(r^2 - s^2/4).
    apart = 2.0 * r * float(np.sqrt(1.0 - (1.0 - _DENT) ** 2))
    count = 1 if not half or not apart else int(min(np.ceil(2.0 * half / apart) + 1, _BALLS))
    centers = np.zeros((count, 3))
    centers[:, along] = np.linspace(-half, half, count) if count > 1 else 0.0
    return centers, np.full(count, r)


def _points(points: Sequence[Vector]) -> Balls:
    return np.array(points, dtype=float).reshape(-1, 3), np.zeros(len(points))


def _joined(*parts: Balls) -> Balls:
    return np.concatenate([c for c, _ in parts]), np.concatenate([r for _, r in parts])


def _hull(m: mujoco.MjModel, mesh: int) -> Iterator[Vector]:
    """Corners of a mesh's hull in the geom's axes, those farthest along many directions."""
    first, count = int(m.mesh_vertadr[mesh]), int(m.mesh_vertnum[mesh])
    corners = np.array(m.mesh_vert[first : first + count], dtype=float)
    if count <= _CORNERS:
        yield from corners
        return
    yield from corners[np.unique(np.argmax(corners @ _directions(_CORNERS).T, axis=0))]


def _directions(count: int) -> Vector:
    """(count, 3) unit vectors all round, by the golden angle."""
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1 - 2 * k / count), np.pi * (1 + 5**0.5) * k
    return np.column_stack(
        [np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)]
    )
