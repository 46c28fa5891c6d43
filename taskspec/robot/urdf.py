"""People's URDF files: meshes by package, limits, and what MuJoCo's own reader passes over."""

from __future__ import annotations

import copy
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from taskspec.deferred import mujoco
from taskspec.deferred_methods import dataclass
from taskspec.robot.errors import RobotError
from taskspec.robot.files import Roots, mesh_token, on_one_line, read_mesh
from taskspec.robot.ros_packages import find_mesh
from taskspec.robot.urdf_limits import check_limits, number

_MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def check_urdf(root: ElementTree.Element) -> None:
    """Checks the numbers of a URDF file.

    Raises:
        RobotError: TS405 when its numbers make no arm.
    """
    check_limits(root)
    for link in root.findall("link"):
        mass, inertia = link.find("inertial/mass"), link.find("inertial/inertia")
        name = link.get("name", "")
        if mass is not None and not 0 <= number(mass, "value", name) < math.inf:
            raise RobotError("TS405", f"link '{name}' has a negative or infinite mass")
        if (
            inertia is not None
            and not np.isfinite([number(inertia, key, name) for key in _MOMENTS]).all()
        ):
            raise RobotError("TS405", f"link '{name}' has an inertia that is not finite")


def urdf_mimics(root: ElementTree.Element) -> dict[str, ElementTree.Element]:
    """The `<mimic>` elements by the names of the joints that follow."""
    mimics = ((joint.get("name", ""), joint.find("mimic")) for joint in root.findall("joint"))
    return {name: mimic for name, mimic in mimics if mimic is not None}


@dataclass(frozen=True, slots=True)
class Drawable:
    """A URDF file that names no other.

    Attributes:
        text: For MuJoCo.
        assets: Meshes by the names that they have in it.
        absent: Meshes that were left out.
    """

    text: str
    assets: dict[str, bytes]
    absent: tuple[str, ...]


def drawable(root: ElementTree.Element, roots: Roots, *, meshes: bool) -> Drawable:
    """The file with nothing but what can be drawn.

    A link shows its visuals, or its collision shapes where no visual can be drawn.

    Args:
        root: The file's elements.
        roots: Where its files may lie.
        meshes: Whether to keep the meshes that are there.
    """
    robot = ElementTree.Element("robot", {"name": root.get("name", "robot")})
    options = ElementTree.SubElement(robot, "mujoco")
    # Inertias are those of the <inertial> elements alone, as URDF has it.
    ElementTree.SubElement(
        options,
        "compiler",
        {
            "fusestatic": "false",
            "discardvisual": "false",
            "strippath": "false",
            "inertiafromgeom": "false",
        },
    )
    absent: set[str] = set()
    assets: dict[str, bytes] = {}
    for element in copy.deepcopy(root):
        if element.tag == "link":
            robot.append(_drawable(element, roots, meshes, assets, absent))
        elif element.tag in ("joint", "material"):
            _drop_textures(element)
            robot.append(element)
    return Drawable(on_one_line(robot), assets, tuple(sorted(absent)))


def urdf_spec(drawn: Drawable) -> tuple[mujoco.MjSpec, list[str]]:
    """The file as a specification that opens no further file, and what was left out of it."""
    spec = mujoco.MjSpec.from_string(drawn.text)
    for mesh in spec.meshes:
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    spec.assets = drawn.assets
    return spec, list(drawn.absent)


def _drawable(
    link: ElementTree.Element,
    roots: Roots,
    meshes: bool,
    assets: dict[str, bytes],
    absent: set[str],
) -> ElementTree.Element:
    """The inertia of `link` and those of its shapes that can be drawn."""
    drawn = ElementTree.Element("link", link.attrib)
    drawn.extend(child for child in link if child.tag == "inertial")
    for kind in ("visual", "collision"):
        for shape in link.findall(kind):
            mesh = shape.find("geometry/mesh")
            if mesh is not None:
                uri = mesh.get("filename", "")
                path = find_mesh(uri, roots.model, roots) if meshes else None
                data = read_mesh(path, assets) if path else None
                if path is None or data is None:
                    absent.add(Path(uri).name)
                    continue
                token = mesh_token(len(assets), path)
                mesh.set("filename", token)
                assets[token] = data
            _drop_textures(shape)
            shape.attrib.clear()
            drawn.append(shape)
        if drawn.find("visual") is not None:
            break
    return drawn


def _drop_textures(element: ElementTree.Element) -> None:
    for parent in list(element.iter()):
        for texture in parent.findall("texture"):
            parent.remove(texture)
