"""Light, sky and floor of a scene: nothing that touches or weighs anything."""

from __future__ import annotations

import mujoco


def dress(spec: mujoco.MjSpec) -> None:
    """Adds what makes a scene good to look at."""
    spec.worldbody.add_light(
        pos=[0.6, -1.2, 2.6], dir=[-0.1, 0.4, -1.0], diffuse=[0.65] * 3, castshadow=True
    )
    spec.visual.headlight.ambient = [0.38] * 3
    spec.visual.headlight.diffuse = [0.38] * 3
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
    spec.add_material(
        name="world/floor", textures=textures, texrepeat=[4, 4], texuniform=True, reflectance=0.05
    )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 0.1],
        pos=[0.0, 0.0, -0.002],
        material="world/floor",
        contype=0,
        conaffinity=0,
        group=1,
    )
