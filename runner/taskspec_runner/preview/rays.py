"""Pictures of a model by rays: exact edges, shadows and no OpenGL."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.deferred_methods import dataclass
from taskspec_runner.video.camera import View, axes_of

Vector = NDArray[np.float64]
Image = NDArray[np.uint8]

#: Groups of geoms that are drawn.
_SHOWN = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)
#: Of the light: where it is from the target of the view [m], and the shares of what it gives,
#: what comes from the eye, and what comes from everywhere.
_LIGHT = np.array([1.0, -2.2, 5.0])
_FROM_LIGHT, _FROM_EYE, _AMBIENT = 0.36, 0.26, 0.46
_IN_SHADOW = 0.82
#: Nearer than this to its light nothing is in a shadow [m]: rounding.
_SKIN = 4e-3
#: Neighbours that differ by more than this, of 1, are an edge, which is drawn by four rays a pixel.
_EDGE = 0.06
_QUARTERS = np.array([[-0.125, -0.375], [0.375, -0.125], [0.125, 0.375], [-0.375, 0.125]])
#: What lies on the floor ends here [m].
_FARTHEST = 30.0


@dataclass(frozen=True, slots=True, eq=False)
class RayCamera:
    """A view as pixels.

    Attributes:
        view: which.
        width, height: [px].
        tangent: of half its vertical angle.
    """

    view: View
    width: int
    height: int
    tangent: float

    @property
    def axes(self) -> Vector:
        """(3, 3) right, up and backward, in rows."""
        return axes_of(self.view.azimuth, self.view.elevation)

    @property
    def eye(self) -> Vector:
        """(3,) its place in the world [m]."""
        return np.asarray(self.view.lookat + self.view.distance * self.axes[2])

    def rays(self, pixels: Vector) -> Vector:
        """(k, 3) unit vectors through pixels (k, 2)."""
        half = self.height / 2
        away = (pixels - np.array([self.width / 2, half])) / half * self.tangent
        found = away[:, :1] * self.axes[0] - away[:, 1:] * self.axes[1] - self.axes[2]
        return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])

    def project(self, points: Vector) -> Vector:
        """(k, 2) pixels of points (k, 3) of the world that lie in front of it."""
        right, up, depth = ((points - self.eye) @ self.axes.T).T
        scale = self.height / 2 / self.tangent / np.maximum(-depth, 1e-6)
        return np.column_stack([self.width / 2 + scale * right, self.height / 2 - scale * up])

    def pixel_size(self, point: Vector) -> float:
        """Length that a pixel is at a point (3,) of the world [m]."""
        depth = float(-(point - self.eye) @ self.axes[2])
        return max(depth, 1e-3) * self.tangent * 2 / self.height


class RayPicture:
    """Draws a model as its data has it."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, paper: Vector) -> None:
        """Prepares drawing on a paper of a colour (3,), of 1, which the floor has too."""
        self._model, self._data, self._paper = model, data, paper
        material = model.geom_matid
        own = model.mat_rgba[material] if model.nmat else model.geom_rgba
        colors = np.where((material >= 0)[:, None], own, model.geom_rgba)[:, :3]
        floor = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        self._floor = floor
        self._colors = np.vstack([np.where(floor[:, None], paper, colors), paper])

    def draw(self, camera: RayCamera) -> Image:
        """(height, width, 3) what a camera shows."""
        width, height = camera.width, camera.height
        y, x = np.mgrid[:height, :width]
        centers = np.column_stack([x.ravel(), y.ravel()]) + 0.5
        image = self._seen(camera, centers).reshape(height, width, 3)
        edges = np.zeros((height, width), dtype=bool)
        for axis in (0, 1):
            steps = np.abs(np.diff(image, axis=axis)).max(axis=2) > _EDGE
            before, after = [slice(None)] * 2, [slice(None)] * 2
            before[axis], after[axis] = slice(None, -1), slice(1, None)
            edges[tuple(before)] |= steps
            edges[tuple(after)] |= steps
        rough = centers[edges.ravel()]
        if len(rough):
            parts = (rough[:, None] + _QUARTERS).reshape(-1, 2)
            image[edges] = self._seen(camera, parts).reshape(-1, len(_QUARTERS), 3).mean(axis=1)
        return np.asarray(np.clip(image, 0, 1) * 255 + 0.5, dtype=np.uint8)

    def _seen(self, camera: RayCamera, pixels: Vector) -> Vector:
        """(k, 3) colours at places (k, 2) of the picture."""
        rays = camera.rays(pixels)
        geom, distance, normal = self._hits(camera.eye, rays)
        light = np.array(camera.view.lookat) + _LIGHT
        points = camera.eye + distance[:, None] * rays
        # What is hit by no ray is as far as shadows go.
        points[geom < 0] = light - _FARTHEST
        towards = points - light
        length = np.linalg.norm(towards, axis=1)
        towards /= length[:, None]
        blocked, nearest, _ = self._hits(light, towards)
        lit = (blocked < 0) | (nearest > length - _SKIN)
        facing = np.clip(-np.einsum("ij,ij->i", normal, towards), 0, 1) * lit
        seen = np.clip(-np.einsum("ij,ij->i", normal, rays), 0, 1)
        shade = _AMBIENT + _FROM_LIGHT * facing + _FROM_EYE * seen
        flat = (geom < 0) | self._floor[geom]
        shade[flat] = np.where(lit | (geom < 0), 1.0, _IN_SHADOW)[flat]
        return np.asarray(self._colors[geom] * shade[:, None])

    def _hits(self, start: Vector, rays: Vector) -> tuple[NDArray[np.int32], Vector, Vector]:
        """Geoms (k,), -1 for none, distances (k,) and normals (k, 3) that rays (k, 3) meet."""
        count = len(rays)
        geom, distance = np.empty(count, dtype=np.int32), np.empty(count)
        normal = np.zeros(3 * count)
        flat = np.ascontiguousarray(rays).ravel()
        mujoco.mj_multiRay(
            self._model, self._data, start, flat, _SHOWN, True, -1, geom, distance, normal, count,
            _FARTHEST,
        )  # fmt: skip
        return geom, distance, normal.reshape(-1, 3)
