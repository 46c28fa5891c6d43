"""Shapes of the world as MuJoCo's geoms: on the world, on what carries them, or loose."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.rotation import from_rpy
from taskspec.spec import Shape
from taskspec_runner.plant.carriers import add_carrier
from taskspec_runner.plant.loose import add_loose
from taskspec_runner.plant.names import INERT, PREFIX, placed, quaternion

Vector = NDArray[np.float64]
Color = tuple[float, float, float, float]

COLORS: tuple[Color, ...] = (
    (0.62, 0.66, 0.70, 1.0),
    (0.75, 0.62, 0.48, 1.0),
    (0.50, 0.62, 0.58, 1.0),
)
#: What is seen of a plane: half edge and half thickness of a slab below the tool [m].
_SLAB, _SLAB_THICKNESS = 0.22, 0.015
#: MuJoCo has no moving planes: half edges and half thickness [m] of the block that stands for one.
_BLOCK, _BLOCK_THICKNESS = 1000.0, 10.0


def add_shape(
    spec: mujoco.MjSpec, name: str, shape: Shape, near: Vector | None, color: Color
) -> None:
    """Adds a shape.

    Args:
        spec: to add to. name: of the object. shape: as the file has it.
        near: (3,) where the tool starts [m], None where that is not known.
        color: red, green, blue, opacity.
    """
    body, place = spec.worldbody, placed(shape)
    if shape.free or shape.motion is not None:
        body = (add_loose if shape.free else add_carrier)(spec, name, shape)
        place = {"pos": [0.0, 0.0, 0.0], "quat": [1.0, 0.0, 0.0, 0.0]}
    kind, size = _solid(shape)
    visible = list(color)
    if shape.shape == "plane":
        # The plane itself is endless; what is seen is a slab of it where the tool starts.
        visible[3] = 0.0
        _add_slab(body, name, shape, near, color)
        if shape.motion is not None:
            kind = mujoco.mjtGeom.mjGEOM_BOX
            size = [_BLOCK, _BLOCK, _BLOCK_THICKNESS]
            place["pos"] = [0.0, 0.0, -_BLOCK_THICKNESS]
    body.add_geom(name=PREFIX + name, type=kind, size=size, rgba=visible, **place, **INERT)


def _solid(shape: Shape) -> tuple[mujoco.mjtGeom, list[float]]:
    radius = shape.radius or 0.0
    if shape.shape == "plane":
        return mujoco.mjtGeom.mjGEOM_PLANE, [0.0, 0.0, 0.1]
    if shape.shape == "box":
        return mujoco.mjtGeom.mjGEOM_BOX, [s / 2 for s in shape.size or (0, 0, 0)]
    if shape.shape == "cylinder":
        return mujoco.mjtGeom.mjGEOM_CYLINDER, [radius, (shape.length or 0.0) / 2, 0.0]
    return mujoco.mjtGeom.mjGEOM_SPHERE, [radius, 0.0, 0.0]


def slab_name(name: str) -> str:
    """Of what is seen of a plane."""
    return f"{PREFIX}{name}/slab"


def _add_slab(
    body: mujoco.MjsBody, name: str, shape: Shape, near: Vector | None, color: Color
) -> None:
    R, origin = from_rpy(shape.rpy), np.array(shape.xyz)
    middle = np.zeros(3)
    if near is not None:
        middle = R.T @ (near - origin)
        middle[2] = 0.0
    middle[2] = -_SLAB_THICKNESS
    place = {"pos": middle.tolist(), "quat": [1.0, 0.0, 0.0, 0.0]}
    if shape.motion is None:
        place = {"pos": (origin + R @ middle).tolist(), "quat": quaternion(R)}
    body.add_geom(
        name=slab_name(name),
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[_SLAB, _SLAB, _SLAB_THICKNESS],
        rgba=list(color),
        group=1,
        **place,
        **INERT,
    )
