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

from taskspec.program.world.frames import surface
from taskspec.shapes import BoundedSurface
from taskspec.spec import Shape, Task
from taskspec_runner.plant.names import INERT, PREFIX, placed

Vector = NDArray[np.float64]


def loose(task: Task) -> dict[str, Shape]:
    """The loose bodies."""
    return {name: shape for name, shape in task.shapes.items() if shape.free}


def solid_of(shape: Shape) -> BoundedSurface:
    """The geometry of a loose body."""
    solid = surface(shape)
    assert isinstance(solid, BoundedSurface)
    return solid


def add_loose(spec: mujoco.MjSpec, name: str, shape: Shape) -> mujoco.MjsBody:
    """Adds a loose body of uniform density with its contact points, and returns it."""
    body = spec.worldbody.add_body(name=PREFIX + name, **placed(shape))
    body.add_freejoint(name=PREFIX + name)
    body.explicitinertial = True
    assert shape.mass is not None
    solid = solid_of(shape)
    body.mass, body.inertia = shape.mass, solid.inertia(shape.mass)
    body.ipos, body.iquat = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    centers, radius = solid.contact_points()
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


def point_name(name: str, number: int) -> str:
    """Name of a contact sphere."""
    return f"{PREFIX}{name}/point{number}"


class LooseBodies:
    """Poses of all loose bodies of a scene.

    Attributes:
        positions: (7 bodies,) where they are in `qpos`.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, task: Task) -> None:
        starts = [int(model.joint(PREFIX + name).qposadr[0]) for name in loose(task)]
        self.positions = np.concatenate([np.arange(at, at + 7) for at in starts])
        self._qpos = data.qpos

    def read(self, poses: Vector) -> None:
        """Writes position [m] and quaternion (w x y z) of each, (7 bodies,)."""
        poses[:] = self._qpos[self.positions]
