"""Light, sky and floor of a scene, bars and knobs: nothing that touches or weighs anything."""

from __future__ import annotations

import mujoco
import numpy as np

from taskspec.geometry.rotation import from_rpy
from taskspec.spec import Mechanism
from taskspec_runner.plant.names import INERT, KNOB, PREFIX, placed

_BASE = (0.36, 0.40, 0.45, 1.0)
_BAR = (0.56, 0.60, 0.66, 1.0)
_KNOB = (0.16, 0.36, 0.56, 1.0)
#: Radii [m] of axis, bar and knob, and half length of what is drawn of an axis.
_AXIS_RADIUS, _BAR_RADIUS, _KNOB_RADIUS, _HALF_AXIS = 0.014, 0.008, 0.016, 0.03
_SHORTEST_BAR = 1e-6


def dress(spec: mujoco.MjSpec) -> None:
    """Adds what makes a scene good to look at."""
    spec.worldbody.add_light(
        pos=[0.6, -1.2, 2.6],
        dir=[-0.1, 0.4, -1.0],
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        diffuse=[0.4] * 3,
        castshadow=True,
    )
    spec.visual.headlight.ambient = [0.5] * 3
    spec.visual.headlight.diffuse = [0.32] * 3
    spec.visual.headlight.specular = [0.1] * 3
    spec.visual.quality.shadowsize = 4096
    spec.add_texture(
        name="world/sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.93, 0.95, 0.97],
        rgb2=[0.72, 0.78, 0.84],
        width=256,
        height=256,
    )
    spec.add_texture(
        name="world/floor",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.86, 0.88, 0.90],
        rgb2=[0.81, 0.84, 0.87],
        width=256,
        height=256,
    )
    textures = [""] * int(mujoco.mjtTextureRole.mjNTEXROLE)
    textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = "world/floor"
    spec.add_material(name="world/floor", textures=textures, texrepeat=[4, 4], texuniform=True)
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.1],
        pos=[0.0, 0.0, -0.002],
        material="world/floor",
        contype=0,
        conaffinity=0,
        group=1,
    )


def draw_mechanism(
    spec: mujoco.MjSpec, name: str, declared: Mechanism, *, handle: bool = True
) -> None:
    """Draws a mechanism: its axis or rail on the world, a bar to the handle, and a knob.

    Args:
        spec: which has the mechanism.
        name: of the object.
        declared: as the file has it.
        handle: whether it has one. What is only pushed has no bar and no knob, and its rail lies
            behind it.
    """
    body = spec.body(PREFIX + name)
    place = placed(declared)
    grip = np.array(declared.handle)
    foot = np.array([0.0, 0.0, grip[2]]) if declared.angular else np.zeros(3)
    reach = _HALF_AXIS + abs(grip[2]) if declared.angular else 4 * _HALF_AXIS
    if not handle and not declared.angular:
        # The tool comes from the other side.
        middle = np.array(declared.xyz) + reach * from_rpy(declared.rpy)[:, 2]
        place["pos"] = middle.tolist()
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[_AXIS_RADIUS if declared.angular else _BAR_RADIUS, reach, 0.0],
        rgba=_BASE,
        group=1,
        **place,
        **INERT,
    )
    if not handle:
        return
    for a, b in ((foot, grip), (np.zeros(3), foot)):
        if np.linalg.norm(b - a) > _SHORTEST_BAR:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=[*a, *b],
                size=[_BAR_RADIUS, 0.0, 0.0],
                rgba=_BAR,
                group=1,
                **INERT,
            )
    free = declared.knob == "free"
    (spec.body(PREFIX + name + KNOB) if free else body).add_geom(
        type=mujoco.mjtGeom.mjGEOM_SPHERE,
        size=[_KNOB_RADIUS, 0.0, 0.0],
        pos=[0.0, 0.0, 0.0] if free else list(declared.handle),
        rgba=_KNOB,
        group=1,
        **INERT,
    )
