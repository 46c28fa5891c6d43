"""Meshes of COLLADA files (.dae), which MuJoCo does not read, as OBJ.

Shapes alone are taken: places of vertices and faces, below the transforms of their scene. The axis
that a file calls up is left as it is, as the tools for URDF do.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
#: Nodes below each other, at most.
_DEPTH = 64


def as_obj(data: bytes) -> bytes | None:
    """The triangles of a COLLADA file in meters as the text of an OBJ file; None without any."""
    try:
        return _converted(data)
    # Of a file that is not as it should be nothing is drawn.
    except (ElementTree.ParseError, ValueError, IndexError, KeyError, AttributeError):
        return None


def _converted(data: bytes) -> bytes | None:
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        return None
    root = ElementTree.fromstring(data)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    unit = root.find("asset/unit")
    meter = float(unit.get("meter", "1")) if unit is not None else 1.0
    shapes = {g.get("id", ""): _triangles(g) for g in root.iter("geometry")}
    points, faces, count = [], [], 0
    for name, transform in _placed(root, shapes.keys()):
        vertices, triangles = shapes[name]
        moved = vertices @ transform[:3, :3].T + transform[:3, 3]
        points.append(meter * moved)
        faces.append(triangles + count + 1)
        count += len(vertices)
    if not count or not sum(map(len, faces)) or not np.isfinite(np.vstack(points)).all():
        return None
    rows = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in np.vstack(points).tolist()]
    rows += [f"f {a} {b} {c}" for a, b, c in np.vstack(faces).tolist()]
    return "\n".join(rows).encode()


def _placed(root: ElementTree.Element, names: Collection[str]) -> Iterator[tuple[str, Vector]]:
    """The geometries of the scene with their (4, 4) transforms; all as they are without a scene."""
    nodes = {n.get("id", ""): n for n in root.iter("node")}
    found = [
        placed
        for scene in root.iter("visual_scene")
        for node in scene.findall("node")
        for placed in _below(node, np.eye(4), nodes, 0)
        if placed[0] in names
    ]
    yield from found or [(name, np.eye(4)) for name in names]


def _below(
    node: ElementTree.Element, outer: Vector, nodes: dict[str, ElementTree.Element], depth: int
) -> Iterator[tuple[str, Vector]]:
    if depth > _DEPTH:
        raise ValueError("nodes are nested too deeply")
    inner = outer
    for element in node:
        inner = inner @ _transform(element)
    for each in node.findall("instance_geometry"):
        yield each.get("url", "").removeprefix("#"), inner
    for child in node.findall("node"):
        yield from _below(child, inner, nodes, depth + 1)
    for each in node.findall("instance_node"):
        shared = nodes[each.get("url", "").removeprefix("#")]
        yield from _below(shared, inner, nodes, depth + 1)


def _transform(element: ElementTree.Element) -> Vector:
    """The (4, 4) transform that an element of a node is; the identity of others."""
    found = np.eye(4)
    if element.tag not in ("matrix", "translate", "rotate", "scale"):
        return found
    numbers = np.array((element.text or "").split(), dtype=float)
    if element.tag == "matrix":
        return numbers.reshape(4, 4)
    if element.tag == "translate":
        found[:3, 3] = numbers
    elif element.tag == "scale":
        found[:3, :3] = np.diag(numbers)
    else:
        # Rodrigues: R = I + sin a K + (1 - cos a) K^2.
        x, y, z = numbers[:3] / np.linalg.norm(numbers[:3])
        angle, cross = np.radians(numbers[3]), np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        found[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return found


def _triangles(geometry: ElementTree.Element) -> tuple[Vector, NDArray[np.int64]]:
    """(n, 3) vertices in the file's unit and (m, 3) triangles of a geometry."""
    sources = {s.get("id", ""): _source(s) for s in geometry.iter("source")}
    places: dict[str, Vector] = {}
    for vertices in geometry.iter("vertices"):
        for each in vertices.findall("input"):
            if each.get("semantic") == "POSITION":
                places[vertices.get("id", "")] = sources[each.get("source", "").removeprefix("#")]
    points, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for kind in ("triangles", "polylist", "polygons"):
        for part in geometry.iter(kind):
            inputs = part.findall("input")
            vertex = next(i for i in inputs if i.get("semantic") == "VERTEX")
            stride = 1 + max(int(i.get("offset", "0")) for i in inputs)
            offset = int(vertex.get("offset", "0"))
            here = places[vertex.get("source", "").removeprefix("#")]
            corners = [_integers(p)[offset::stride] for p in part.findall("p")]
            listed = _fans(part, kind, corners)
            if len(listed) and (listed.min() < 0 or listed.max() >= len(here)):
                raise ValueError("a face names a vertex that is not there")
            points.append(here)
            faces.append(listed + count)
            count += len(here)
    return np.vstack(points), np.vstack(faces)


def _fans(
    part: ElementTree.Element, kind: str, corners: list[NDArray[np.int64]]
) -> NDArray[np.int64]:
    """(m, 3) triangles of faces, each cut into a fan about its first corner."""
    if kind == "triangles":
        return np.concatenate([c.reshape(-1, 3) for c in corners] or [np.zeros((0, 3), int)])
    if kind == "polylist":
        counts = _integers(part.find("vcount"))
        corners = np.split(corners[0], np.cumsum(counts)[:-1]) if corners else []
    fans = [(c[0], c[i], c[i + 1]) for c in corners for i in range(1, len(c) - 1)]
    return np.array(fans, dtype=np.int64).reshape(-1, 3)


def _source(source: ElementTree.Element) -> Vector:
    """(n, 3) the first three numbers of each entry of a source."""
    numbers = np.array((source.findtext("float_array") or "").split(), dtype=float)
    accessor = source.find("technique_common/accessor")
    stride = int(accessor.get("stride", "3")) if accessor is not None else 3
    if stride < 3:
        return np.zeros((0, 3))
    return np.asarray(numbers[: len(numbers) // stride * stride].reshape(-1, stride)[:, :3])


def _integers(element: ElementTree.Element | None) -> NDArray[np.int64]:
    text = element.text if element is not None else ""
    return np.array((text or "").split(), dtype=np.int64)
