"""The arm of a run as URDF, in which its meshes are embedded."""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Callable, Iterable
from xml.etree import ElementTree

import mujoco
import numpy as np
from numpy.typing import NDArray

from taskspec.geometry.rotation import from_rpy
from taskspec_runner.export.scene import WORLD, RunScene, SceneLink, ScenePiece

Vector = NDArray[np.float64]
Faces = NDArray[np.int64]

#: What Foxglove knows of a binary glTF file.
_GLB = "data:model/gltf-binary;base64,"
#: From axes of which z points up to those of glTF, of which y does.
_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
#: Types of numbers in glTF, and how finely an ellipsoid is cut.
_FLOAT, _UNSIGNED = 5126, 5125
_PARALLELS, _MERIDIANS = 12, 24


#: The URL of a mesh of vertices (n, 3) [m] and faces (m, 3).
MeshUrl = Callable[[Vector, Faces], str]


def robot_description(scene: RunScene, name: str, mesh_url: MeshUrl | None = None) -> str:
    """The URDF of a run's arm: links, joints with their limits, inertias, and what is drawn.

    Its root is the world. A joint that follows one other joint mimics it.

    Args:
        scene: of the run.
        name: of the robot.
        mesh_url: where a mesh is; None for `data:` URLs of glTF, for which a viewer needs no file.
    """
    url = mesh_url or _glb
    robot = ElementTree.Element("robot", name=name)
    ElementTree.SubElement(robot, "link", name=WORLD)
    pieces = dict[str, list[ScenePiece]]()
    for piece in scene.pieces_of_arm(arm=True):
        pieces.setdefault(piece.frame, []).append(piece)
    for link in scene.links:
        made = ElementTree.SubElement(robot, "link", name=link.name)
        if link.body >= 0 and scene.model.body_mass[link.body] > 0.0:
            made.append(_inertial(scene.model, link.body))
        for piece in pieces.get(link.name, ()):
            made.append(_visual(piece, url))
        robot.append(_joint(scene, link))
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode", xml_declaration=True)


def _joint(scene: RunScene, link: SceneLink) -> ElementTree.Element:
    model = scene.model
    kind, limits = "fixed", None
    if link.joint:
        joint = model.joint(link.joint).id
        if model.jnt_limited[joint]:
            limits = model.jnt_range[joint]
        kind = "prismatic" if not link.hinge else "continuous" if limits is None else "revolute"
    made = ElementTree.Element("joint", name=link.joint or f"{link.name}_fixed", type=kind)
    made.append(_origin(link.pose))
    ElementTree.SubElement(made, "parent", link=link.parent)
    ElementTree.SubElement(made, "child", link=link.name)
    if not link.joint:
        return made
    ElementTree.SubElement(made, "axis", xyz=_text(link.axis))
    # A joint that slides has limits in URDF; these let it go anywhere.
    low, high = (-1e3, 1e3) if limits is None else limits
    bounds = {} if kind == "continuous" else {"lower": _text([low]), "upper": _text([high])}
    effort = float(np.abs(model.jnt_actfrcrange[joint]).max()) or 1e6
    ElementTree.SubElement(made, "limit", bounds, effort=_text([effort]), velocity="1e3")
    coupling = scene.coupling
    number = coupling.names.index(link.joint)
    followed = np.flatnonzero(coupling.ratios[number]).tolist()
    if number in coupling.followers and len(followed) == 1:
        ElementTree.SubElement(
            made, "mimic",
            joint=coupling.names[coupling.free[followed[0]]],
            multiplier=_text([coupling.ratios[number, followed[0]]]),
            offset=_text([coupling.offsets[number]]),
        )  # fmt: skip
    return made


def _inertial(model: mujoco.MjModel, body: int) -> ElementTree.Element:
    made = ElementTree.Element("inertial")
    made.append(
        _origin(np.concatenate([model.body_ipos[body], np.roll(model.body_iquat[body], -1)]))
    )
    ElementTree.SubElement(made, "mass", value=_text([model.body_mass[body]]))
    moments = dict(zip(("ixx", "iyy", "izz"), model.body_inertia[body].tolist(), strict=True))
    products = dict.fromkeys(("ixy", "ixz", "iyz"), 0.0)
    ElementTree.SubElement(
        made, "inertia", {key: _text([value]) for key, value in (moments | products).items()}
    )
    return made


def _visual(piece: ScenePiece, url: MeshUrl) -> ElementTree.Element:
    made = ElementTree.Element("visual")
    made.append(_origin(piece.pose))
    geometry = ElementTree.SubElement(made, "geometry")
    a, _, c = piece.size
    if piece.kind == "box":
        ElementTree.SubElement(geometry, "box", size=_text(piece.size))
    elif piece.kind == "cylinder":
        ElementTree.SubElement(geometry, "cylinder", radius=_text([a / 2]), length=_text([c]))
    elif piece.kind == "sphere" and np.ptp(piece.size) == 0.0:
        ElementTree.SubElement(geometry, "sphere", radius=_text([a / 2]))
    elif piece.kind == "sphere":
        ElementTree.SubElement(geometry, "mesh", filename=url(*_ellipsoid(piece.size)))
    else:
        assert piece.vertices is not None
        assert piece.faces is not None
        ElementTree.SubElement(geometry, "mesh", filename=url(piece.vertices, piece.faces))
    color = _text(piece.color)
    material = ElementTree.SubElement(made, "material", name=f"rgba {color}")
    ElementTree.SubElement(material, "color", rgba=color)
    return made


def _ellipsoid(size: Vector) -> tuple[Vector, Faces]:
    """Vertices (n, 3) and faces (m, 3) of an ellipsoid of some extent (3,)."""
    along, around = np.mgrid[0 : _PARALLELS + 1, 0:_MERIDIANS]
    polar, azimuth = np.pi * along / _PARALLELS, 2 * np.pi * around / _MERIDIANS
    unit = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    corner = along[:-1] * _MERIDIANS + around[:-1]
    beside = along[:-1] * _MERIDIANS + (around[:-1] + 1) % _MERIDIANS
    upper = [corner, corner + _MERIDIANS, beside]
    lower = [beside, corner + _MERIDIANS, beside + _MERIDIANS]
    faces = np.vstack([np.stack(half, axis=2).reshape(-1, 3) for half in (upper, lower)])
    return np.stack(unit, axis=2).reshape(-1, 3) * size / 2, faces


def _glb(vertices: Vector, faces: Faces) -> str:
    """A mesh as a URL that holds it as binary glTF.

    Of the formats that Foxglove reads it is the one whose axes do not depend on a setting.
    """
    points = np.ascontiguousarray(vertices @ _Y_UP.T, dtype="<f4")
    numbers = np.ascontiguousarray(faces, dtype="<u4")
    blocks = points.tobytes(), numbers.tobytes()
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": len(block)}
        for start, block in zip((0, len(blocks[0])), blocks, strict=True)
    ]
    accessors = [
        {
            "bufferView": 0, "componentType": _FLOAT, "count": len(points), "type": "VEC3",
            "min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist(),
        },
        {
            "bufferView": 1, "componentType": _UNSIGNED, "count": numbers.size, "type": "SCALAR",
        },
    ]  # fmt: skip
    content = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": sum(map(len, blocks))}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    text = json.dumps(content, separators=(",", ":")).encode()
    chunks = (b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", b"".join(blocks))
    body = b"".join(struct.pack("<I", len(data)) + kind + data for kind, data in chunks)
    file = struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body
    return _GLB + base64.b64encode(file).decode()


def _origin(pose: Vector) -> ElementTree.Element:
    """An origin of a pose (7,), exact also where the pitch is near 90 deg."""
    entries = np.zeros(9)
    mujoco.mju_quat2Mat(entries, np.roll(pose[3:], 1))
    R = entries.reshape(3, 3)
    yaw = math.atan2(R[1, 0], R[0, 0])
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    # What is left is a roll, whatever the yaw is taken to be.
    left = from_rpy([0.0, pitch, yaw]).T @ R
    roll = math.atan2(left[2, 1], left[1, 1])
    return ElementTree.Element("origin", xyz=_text(pose[:3]), rpy=_text([roll, pitch, yaw]))


def _text(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in numbers)
