"""Loose bodies: what lies about and can be pushed, lifted and grasped.

A loose body touches other shapes with the small spheres of its corners or rims, the tool with its
whole shape. A face that lies flat rests on four corners, a cylinder's end on eight points of its
rim; each carries an equal share of the declared stiffness, so that the whole contact has it.
Fewer points, as on an edge or on a cylinder's side, are softer by as much. Of two bodies the
later one of the file touches with its points.
"""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.spec import Shape, Task
from taskspec_runner.plant.names import INERT, PREFIX, placed

Vector = NDArray[np.float64]

#: Radius of the spheres at corners and rims [m], or a quarter of the least half extent.
_POINT = 0.0005
_RIM_POINTS = 8


def loose(task: Task) -> dict[str, Shape]:
    """The loose bodies."""
    return {name: shape for name, shape in task.shapes.items() if shape.free}


def add_loose(spec: mujoco.MjSpec, name: str, shape: Shape) -> mujoco.MjsBody:
    """Adds a loose body of uniform density with its contact points, and returns it."""
    body = spec.worldbody.add_body(name=PREFIX + name, **placed(shape))
    body.add_freejoint(name=PREFIX + name)
    body.explicitinertial = True
    assert shape.mass is not None
    body.mass, body.inertia = shape.mass, inertia(shape)
    body.ipos, body.iquat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    centers, radius = points(shape)
    for number, center in enumerate(centers):
        body.add_geom(
            name=point_name(name, number),
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            pos=center,
            size=[radius, 0.0, 0.0],
            rgba=[0.0, 0.0, 0.0, 0.0],
            group=4,
            **INERT,
        )
    return body


def inertia(shape: Shape) -> list[float]:
    """Principal moments (3,) [kg m^2] about its own axes, of uniform density."""
    m = shape.mass or 0.0
    if shape.size is not None:
        x, y, z = np.square(shape.size)
        return [float(m * s / 12) for s in (y + z, x + z, x + y)]
    r = shape.radius or 0.0
    if shape.shape == "sphere":
        return [0.4 * m * r**2] * 3
    across = m * (r**2 / 4 + (shape.length or 0.0) ** 2 / 12)
    return [across, across, m * r**2 / 2]


def points(shape: Shape) -> tuple[Vector, float]:
    """Centres (k, 3) [m] of a body's contact spheres in its own axes, and their radius."""
    if shape.shape == "sphere":
        return np.zeros((1, 3)), float(shape.radius or 0.0)
    if shape.size is not None:
        half = np.array(shape.size) / 2
        point = min(_POINT, float(half.min()) / 4)
        signs = np.array(np.meshgrid(*[(-1, 1)] * 3, indexing="ij")).reshape(3, -1).T
        return signs * (half - point), point
    r, z = float(shape.radius or 0.0), (shape.length or 0.0) / 2
    point = min(_POINT, r / 4, z / 4)
    angles = 2 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
    rim = (r - point) * np.column_stack((np.cos(angles), np.sin(angles)))
    ends = [np.column_stack((rim, np.full(_RIM_POINTS, s * (z - point)))) for s in (-1, 1)]
    return np.vstack(ends), point


def resting_points(shape: Shape) -> int:
    """How many points carry a body that lies flat."""
    return {"sphere": 1, "box": 4, "cylinder": _RIM_POINTS}[shape.shape]


def point_name(name: str, number: int) -> str:
    """Of a contact sphere."""
    return f"{PREFIX}{name}/point{number}"


class LooseBodies:
    """Poses of all loose bodies of a scene."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, task: Task) -> None:
        starts = [int(model.joint(PREFIX + name).qposadr[0]) for name in loose(task)]
        self._at = np.concatenate([np.arange(at, at + 7) for at in starts])
        self._qpos = data.qpos

    def read(self, poses: Vector) -> None:
        """Writes position [m] and quaternion (w x y z) of each, (7 bodies,)."""
        poses[:] = self._qpos[self._at]
