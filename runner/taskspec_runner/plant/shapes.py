"""Shapes of the world as MuJoCo's geoms: on the world, on what moves them, or loose."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.program.world.frames import pose, surface
from taskspec.robot.geoms import add_geom
from taskspec.shapes import Geom
from taskspec.spec import Shape
from taskspec_runner.plant.loose import add_loose
from taskspec_runner.plant.moving_base import add_moving_base
from taskspec_runner.plant.names import INERT, PREFIX

Vector = NDArray[np.float64]
Color = tuple[float, float, float, float]

COLORS: tuple[Color, ...] = (
    (0.62, 0.66, 0.70, 1.0),
    (0.75, 0.62, 0.48, 1.0),
    (0.50, 0.62, 0.58, 1.0),
)
#: How far an endless shape is drawn along its x and y, about where the tool starts [m].
_VISIBLE = np.array([0.22, 0.22])


def add_shape(
    spec: mujoco.MjSpec,
    name: str,
    shape: Shape,
    near: Vector | None,
    color: Color,
    own: Shape | None = None,
) -> None:
    """Adds a shape; the mechanism that carries it is there already.

    Args:
        spec: to add to.
        name: of the object.
        shape: as the file has it.
        near: (3,) where the tool starts [m], None where that is not known.
        color: red, green, blue, opacity.
        own: the shape in the axes of the mechanism that carries it; None where none does.
    """
    body, solid, moves = spec.worldbody, surface(shape), shape.motion is not None
    origin, rotation = solid.origin, solid.rotation
    if shape.free or moves:
        body = (add_loose if shape.free else add_moving_base)(spec, name, shape)
        origin, rotation = np.zeros(3), np.eye(3)
    elif own is not None:
        body = spec.body(f"{PREFIX}{own.on}")
        rotation, origin = pose(own)
    middle = np.zeros(3) if near is None else solid.rotation.T @ (near - solid.origin)
    visible = solid.visible_geom(middle, _VISIBLE)
    if visible is not None:
        look = {"name": visible_name(name), "rgba": list(color), "group": 1}
        if visible.corners is not None:
            _add_mesh(spec, visible_name(name), visible)
            look["meshname"] = visible_name(name)
        add_geom(body, visible, origin, rotation, **look, **INERT)
        color = (*color[:3], 0.0)
    geom = solid.moving_geom() if moves else solid.geom()
    look = {"name": PREFIX + name, "rgba": list(color)}
    if geom.corners is not None:
        _add_mesh(spec, PREFIX + name, geom)
        look["meshname"] = PREFIX + name
    add_geom(body, geom, origin, rotation, **look, **INERT)


def _add_mesh(spec: mujoco.MjSpec, name: str, geom: Geom) -> None:
    assert geom.corners is not None
    assert geom.faces is not None
    mesh = spec.add_mesh(name=name)
    mesh.uservert, mesh.userface = geom.corners.ravel().tolist(), geom.faces.ravel().tolist()
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL


def visible_name(name: str) -> str:
    """The geom that is drawn of an endless shape."""
    return f"{PREFIX}{name}/slab"
