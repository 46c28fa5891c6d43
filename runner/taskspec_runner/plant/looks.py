"""Light, sky and floor of a scene, bars, knobs and stands: nothing that touches or weighs."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.rotation import from_rpy
from taskspec.program.world.frames import surface
from taskspec.spec import Mechanism, Task
from taskspec_runner.plant.names import INERT, KNOB, PREFIX, placed
from taskspec_runner.plant.shapes import visible_name

Vector = NDArray[np.float64]

_BASE = (0.36, 0.40, 0.45, 1.0)
_BAR = (0.56, 0.60, 0.66, 1.0)
_KNOB = (0.16, 0.36, 0.56, 1.0)
#: Radii [m] of axis, bar and knob, and half length of what is drawn of an axis.
_AXIS_RADIUS, _BAR_RADIUS, _KNOB_RADIUS, _HALF_AXIS = 0.014, 0.008, 0.016, 0.03
_SHORTEST_BAR = 1e-6
_STAND = (0.46, 0.50, 0.55, 1.0)
#: Most of a stand's radius [m], and the least height of one [m].
_STAND_RADIUS, _LOWEST = 0.03, 0.02
#: What is drawn of an endless shape goes beyond the tool's path over it by this much [m].
_MARGIN = 0.14


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
        name=_rail(name),
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


def _rail(name: str) -> str:
    """The geom that is drawn of a mechanism's axis or rail."""
    return f"{PREFIX}{name}/rail"


def add_stands(spec: mujoco.MjSpec, task: Task) -> None:
    """Adds the stands of what does not give way; `settle` puts each where its object is."""
    for name, shape in task.shapes.items():
        if not shape.gives_way:
            _add_stand(spec.geom(visible_name(name)) or spec.geom(PREFIX + name))
    for name in task.mechanisms:
        _add_stand(spec.geom(_rail(name)))


def _add_stand(shown: mujoco.MjsGeom) -> None:
    shown.parent.add_geom(
        name=f"{shown.name}/stand",
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[_STAND_RADIUS, 0.1, 0.0],
        rgba=_STAND,
        group=1,
        **INERT,
    )


def settle(model: mujoco.MjModel, data: mujoco.MjData, task: Task, tip: Vector) -> None:
    """Draws endless shapes where the tool goes over them, and stands below what stands still.

    Args:
        model: of a scene that is drawn; changed.
        data: of it, at the start of the run.
        task: of the scene.
        tip: (n, 3) the tool's path in the world [m].
    """
    for name in task.shapes:
        _show_endless(model, task, name, tip)
    mujoco.mj_kinematics(model, data)
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        if name.endswith("/stand"):
            _place_stand(model, data, geom, model.geom(name.removesuffix("/stand")).id)


def _show_endless(model: mujoco.MjModel, task: Task, name: str, tip: Vector) -> None:
    shape = task.shapes[name]
    solid = surface(shape)
    R, origin = solid.rotation, solid.origin
    over = (tip - origin) @ R
    low, high = over.min(axis=0) - _MARGIN, over.max(axis=0) + _MARGIN
    visible = solid.visible_geom((high + low) / 2, (high - low)[:2] / 2)
    if visible is None or visible.corners is not None:
        return
    geom, center = model.geom(visible_name(name)).id, np.array(visible.center)
    model.geom_size[geom] = visible.size
    model.geom_pos[geom] = center if shape.motion is not None else origin + R @ center
    model.geom_sameframe[geom] = 0
    model.geom_rbound[geom] = float(np.linalg.norm(visible.size))
    model.geom_aabb[geom] = [0.0, 0.0, 0.0, *visible.size]


def _place_stand(model: mujoco.MjModel, data: mujoco.MjData, stand: int, shown: int) -> None:
    """A post from the lowest of what is shown down to the floor."""
    R, box = data.geom_xmat[shown].reshape(3, 3), model.geom_aabb[shown]
    middle, half = data.geom_xpos[shown] + R @ box[:3], np.abs(R) @ box[3:]
    height = float(middle[2] - half[2])
    if height < _LOWEST:
        model.geom_rgba[stand, 3] = 0.0
        return
    # It reaches into what it bears, where that is tilted.
    top = height + 0.5 * half[2]
    body = int(model.geom_bodyid[stand])
    B, at = data.xmat[body].reshape(3, 3), np.array([*middle[:2], top / 2])
    model.geom_pos[stand] = B.T @ (at - data.xpos[body])
    mujoco.mju_mat2Quat(model.geom_quat[stand], np.ascontiguousarray(B.T).ravel())
    radius = min(_STAND_RADIUS, 0.6 * float(half[:2].min()))
    model.geom_size[stand] = [radius, top / 2, 0.0]
    model.geom_sameframe[stand] = 0
    model.geom_rbound[stand] = float(np.hypot(radius, top / 2))
    model.geom_aabb[stand] = [0.0, 0.0, 0.0, radius, radius, top / 2]
