"""A model of MuJoCo as data that a page draws and moves: bodies, joints, geoms, meshes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec_runner.scene.meshes import Triangles, within
from taskspec_runner.video.camera import Framing

Vector = NDArray[np.float64]
Json = dict[str, Any]

#: Geoms of higher groups are not shown, as in MuJoCo's viewer.
_SHOWN_GROUPS = 3
#: The colour of a geom that has none of its own: its material's is taken.
_UNSET = (0.5, 0.5, 0.5, 1.0)
#: Numbers of a page have so many digits after the point: 10 um.
_DIGITS = 5
_SHAPES = {
    mujoco.mjtGeom.mjGEOM_PLANE: "plane",
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
    mujoco.mjtGeom.mjGEOM_HFIELD: "mesh",
    mujoco.mjtGeom.mjGEOM_SDF: "mesh",
}
_JOINTS = {
    mujoco.mjtJoint.mjJNT_FREE: "free",
    mujoco.mjtJoint.mjJNT_BALL: "ball",
    mujoco.mjtJoint.mjJNT_SLIDE: "slide",
    mujoco.mjtJoint.mjJNT_HINGE: "hinge",
}


def model_scene(
    model: mujoco.MjModel,
    framing: Framing,
    tip: int,
    *,
    links: Iterable[tuple[int, int]] = (),
) -> Json:
    """What is in a scene, as `taskspecScene.create` takes it; nothing in it depends on a state.

    Args:
        model: of the arm in its world.
        framing: what the camera shows at first.
        tip: the body of the tool's tip, whose place on the page `create` states.
        links: pairs of bodies between which a link is drawn.

    Returns:
        `bodies`, `geoms`, `meshes`, `links`, `tip`, `width` (how many numbers a row of positions
        has) and `view`.
    """
    geoms, meshes = _geoms(model)
    return {
        "bodies": list(_bodies(model)),
        "geoms": geoms,
        "meshes": [mesh.packed() for mesh in within(meshes)],
        "links": [list(link) for link in links],
        "tip": tip,
        "width": model.nq + 7 * model.nmocap,
        "view": {"fovy": float(model.vis.global_.fovy), **asdict(framing)},
    }


def positions(data: mujoco.MjData) -> Vector:
    """(width,) all that moves a scene: `qpos`, then positions and quaternions of mocap bodies."""
    return np.concatenate([data.qpos, np.hstack([data.mocap_pos, data.mocap_quat]).ravel()])


def _bodies(model: mujoco.MjModel) -> Iterator[Json]:
    """Bodies after the world: `parent`, pose in it, and joints in the order of their turning."""
    for body in range(1, model.nbody):
        joints = []
        first = int(model.body_jntadr[body])
        for joint in range(first, first + int(model.body_jntnum[body])):
            at = int(model.jnt_qposadr[joint])
            joints.append(
                {
                    "kind": _JOINTS[mujoco.mjtJoint(model.jnt_type[joint])],
                    "at": at,
                    "pos": _rounded(model.jnt_pos[joint]),
                    "axis": model.jnt_axis[joint].tolist(),
                    "zero": float(model.qpos0[at]),
                }
            )
        mocap = int(model.body_mocapid[body])
        if mocap >= 0:
            # It is where it is put, as a free body.
            joints = [{"kind": "free", "at": model.nq + 7 * mocap}]
        yield {
            "parent": int(model.body_parentid[body]),
            "pos": model.body_pos[body].tolist(),
            "quat": model.body_quat[body].tolist(),
            "joints": joints,
        }


def _geoms(model: mujoco.MjModel) -> tuple[list[Json], list[Triangles]]:
    """Visible geoms, and the meshes that they go by."""
    found: list[Json] = []
    numbers: dict[tuple[bool, int], int] = {}
    meshes: list[Triangles] = []
    for geom in range(model.ngeom):
        shape = _SHAPES.get(mujoco.mjtGeom(model.geom_type[geom]))
        color = _color(model, geom)
        if shape is None or model.geom_group[geom] >= _SHOWN_GROUPS or color[3] <= 0:
            continue
        shown = geom_data(
            int(model.geom_bodyid[geom]),
            shape,
            model.geom_size[geom],
            model.geom_pos[geom],
            model.geom_quat[geom],
            color,
        )
        if shape == "mesh":
            field = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_HFIELD
            number = int(model.geom_dataid[geom])
            if (field, number) not in numbers:
                numbers[field, number] = len(meshes)
                meshes.append(_field(model, number) if field else Triangles.of(model, number))
            shown["mesh"] = numbers[field, number]
        found.append(shown)
    return found, meshes


def geom_data(
    body: int, shape: str, size: Any, pos: Any, quat: Any, color: Iterable[float]
) -> Json:
    """A geom as the script draws it: sizes as MuJoCo has them, pose in its body, RGBA."""
    return {
        "body": body,
        "shape": shape,
        "size": _rounded(size),
        "pos": _rounded(pos),
        "quat": np.round(quat, 7).tolist(),
        "color": [round(float(each), 3) for each in color],
    }


def coloring_material(model: mujoco.MjModel, geom: int) -> int:
    """The number of the material that gives a geom its colour; -1 where it has one of its own."""
    material = int(model.geom_matid[geom])
    return material if np.allclose(model.geom_rgba[geom], _UNSET) else -1


def _color(model: mujoco.MjModel, geom: int) -> list[float]:
    """RGBA of a geom; of a texture its mean."""
    material = coloring_material(model, geom)
    if material < 0:
        return [float(each) for each in model.geom_rgba[geom]]
    color = model.mat_rgba[material].astype(float)
    texture = int(model.mat_texid[material, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)])
    if texture >= 0:
        channels = int(model.tex_nchannel[texture])
        first = int(model.tex_adr[texture])
        count = int(model.tex_height[texture]) * int(model.tex_width[texture]) * channels
        texels = model.tex_data[first : first + count].reshape(-1, channels)[:, :3]
        color[:3] *= texels.mean(axis=0) / 255
    return [float(each) for each in color]


def _field(model: mujoco.MjModel, number: int) -> Triangles:
    """The upper side of a height field."""
    rows, columns = int(model.hfield_nrow[number]), int(model.hfield_ncol[number])
    first = int(model.hfield_adr[number])
    half_x, half_y, height, _ = model.hfield_size[number]
    y, x = np.meshgrid(
        np.linspace(-half_y, half_y, rows), np.linspace(-half_x, half_x, columns), indexing="ij"
    )
    z = height * model.hfield_data[first : first + rows * columns]
    corner = np.arange(rows * columns).reshape(rows, columns)[:-1, :-1].ravel()
    lower = np.column_stack([corner, corner + 1, corner + columns + 1])
    upper = np.column_stack([corner, corner + columns + 1, corner + columns])
    return Triangles(np.column_stack([x.ravel(), y.ravel(), z]), np.vstack([lower, upper]))


def _rounded(values: Any) -> Any:
    return np.round(values, _DIGITS).tolist()
