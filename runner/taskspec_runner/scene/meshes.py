"""Triangles of meshes in as few bytes as a page has room for."""

from __future__ import annotations

import base64
from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.record.folder import Json

Vector = NDArray[np.float64]
Indices = NDArray[np.int64]

#: All meshes of a scene have no more triangles than this.
MOST_TRIANGLES = 60_000
#: Points of meshes that are too fine are merged in cells of this edge [m], which grows by a factor
#: until there are few enough triangles.
_CELL, _GROWTH = 5e-4, 1.4
#: A coordinate is stored as a share of its mesh's extent, in so many steps.
_STEPS = 2**16 - 1


@dataclass(frozen=True, slots=True)
class Triangles:
    """A mesh: vertices (k, 3) [m] and faces (n, 3) of their numbers."""

    vertices: Vector
    faces: Indices

    @classmethod
    def of(cls, model: mujoco.MjModel, mesh: int) -> Triangles:
        """A mesh of a model, by its number."""
        first, start = int(model.mesh_vertadr[mesh]), int(model.mesh_faceadr[mesh])
        return cls(
            model.mesh_vert[first : first + int(model.mesh_vertnum[mesh])].astype(float),
            model.mesh_face[start : start + int(model.mesh_facenum[mesh])].astype(np.int64),
        )

    def clustered(self, cell: float) -> Triangles:
        """The mesh with all vertices of a cell of a grid [m] in their mean."""
        grid = np.floor((self.vertices - self.vertices.min(axis=0)) / cell).astype(np.int64)
        room = grid.max(axis=0) + 1
        key = (grid[:, 0] * room[1] + grid[:, 1]) * room[2] + grid[:, 2]
        _, of, count = np.unique(key, return_inverse=True, return_counts=True)
        vertices = np.column_stack([np.bincount(of, self.vertices[:, i]) / count for i in range(3)])
        faces = of[self.faces]
        a, b, c = faces.T
        faces = faces[(a != b) & (b != c) & (a != c)]
        # The least number first: what is the same triangle is then the same row.
        turned = (np.arange(3) + faces.argmin(axis=1)[:, None]) % 3
        return Triangles(vertices, np.unique(np.take_along_axis(faces, turned, 1), axis=0))

    def packed(self) -> Json:
        """As `js/build.js` reads it: `low` (3,) and `extent` (3,) [m], `vertices`, `faces`."""
        low, extent = self.vertices.min(axis=0), np.ptp(self.vertices, axis=0)
        steps = np.rint((self.vertices - low) / np.maximum(extent, 1e-12) * _STEPS)
        return {
            "low": low.tolist(),
            "extent": extent.tolist(),
            "vertices": text(steps.astype("<u2")),
            "faces": text(self.faces.astype("<u4")),
        }


def within(meshes: Sequence[Triangles], most: int = MOST_TRIANGLES) -> list[Triangles]:
    """Meshes of no more than `most` triangles together: the same ones, or all of them coarser."""
    found, cell = list(meshes), _CELL
    while sum(len(mesh.faces) for mesh in found) > most:
        found = [mesh.clustered(cell) for mesh in meshes]
        cell *= _GROWTH
    return found


def text(values: NDArray[np.generic]) -> str:
    """Numbers in base 64, as a script makes an array of them."""
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()
