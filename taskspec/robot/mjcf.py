"""People's MJCF files: includes, meshes, and what MuJoCo is not let near."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from taskspec.deferred import mujoco
from taskspec.robot.bounds import check_growth
from taskspec.robot.chain import FRAME_SITE
from taskspec.robot.errors import RobotError
from taskspec.robot.files import (
    Roots,
    check_size,
    is_regular,
    mesh_token,
    on_one_line,
    parse_xml,
    read_mesh,
    read_model,
)
from taskspec.robot.ros_packages import find_mesh
from taskspec.text.confines import REMEDY, here

_INCLUDES = 20
_REFUSED = {
    "extension": "plugins are programs",
    "plugin": "plugins are programs",
    "composite": "an arm has rigid bodies",
    "flexcomp": "an arm has rigid bodies",
    "deformable": "an arm has rigid bodies",
    "attach": "use <include> instead",
    "model": "use <include> instead",
}


def mjcf_text(text: str, root: ElementTree.Element, shown: str, roots: Roots) -> str:
    """An MJCF file with its includes in place.

    The text is the user's own where nothing is included, so that MuJoCo's line numbers are right.

    Args:
        text: As read.
        root: Its elements.
        shown: The file as the user wrote it.
        roots: Where other files may lie.

    Raises:
        RobotError: TS402 or TS403.
    """
    done: set[Path] = set()
    while (include := next(root.iter("include"), None)) is not None:
        included = _read_include(include, shown, roots, done)
        parent = next(element for element in root.iter() if include in list(element))
        at = list(parent).index(include)
        parent[at : at + 1] = list(included)
        check_size(root, shown)
    _refuse(root, shown)
    return on_one_line(root) if done else text


def _read_include(
    include: ElementTree.Element, shown: str, roots: Roots, done: set[Path]
) -> ElementTree.Element:
    """The elements of an included file, in which further includes are absolute paths."""
    name = include.get("file", "")
    path = here(roots.model / name)
    if not roots.hold(path):
        raise RobotError(
            "TS403", f"'{shown}' includes '{name}' from outside of the task's project", REMEDY
        )
    if not is_regular(path):
        raise RobotError("TS402", f"'{shown}' includes '{name}', which is not there")
    if path.resolve() in done or len(done) == _INCLUDES:
        raise RobotError("TS403", f"'{name}' is included twice, or too many files are")
    done.add(path.resolve())
    included = parse_xml(read_model(path, name, roots.confines), name)
    for further in included.iter("include"):
        beside_model, beside_file = (
            folder / further.get("file", "") for folder in (roots.model, path.parent)
        )
        further.set(
            "file", str(beside_model if is_regular(beside_model) else beside_file.absolute())
        )
    return included


def _refuse(root: ElementTree.Element, shown: str) -> None:
    for element in root.iter():
        if element.tag in _REFUSED:
            raise RobotError(
                "TS403", f"'{shown}' has a <{element.tag}>, which is refused", _REFUSED[element.tag]
            )
    check_growth(root, shown)


def mjcf_spec(text: str, roots: Roots, *, meshes: bool) -> tuple[mujoco.MjSpec, list[str]]:
    """The file as a specification that opens no further file, and what was left out of it.

    Args:
        text: As `mjcf_text` gives it.
        roots: Where its files may lie.
        meshes: Whether to keep the meshes that are there.
    """
    spec = mujoco.MjSpec.from_string(text)
    absent = _take_meshes(spec, roots, meshes)
    for geom in list(spec.geoms):
        if geom.hfieldname or geom.meshname in absent:
            spec.delete(geom)
    for material in spec.materials:
        material.textures = [""] * len(material.textures)
    unused = (spec.textures, spec.hfields, spec.skins, spec.pairs, spec.excludes, spec.sensors)
    for group in unused:
        for element in list(group):
            spec.delete(element)
    for frame in list(spec.frames):
        if frame.name:
            frame.parent.add_site(name=FRAME_SITE + frame.name).set_frame(frame)
    return spec, sorted(set(absent.values()))


def _take_meshes(spec: mujoco.MjSpec, roots: Roots, keep: bool) -> dict[str, str]:
    """Hands the bytes of the meshes to `spec`; deletes the others, returns their files by name."""
    absent: dict[str, str] = {}
    assets: dict[str, bytes] = {}
    folder = roots.model / spec.meshdir
    for i, mesh in enumerate(list(spec.meshes)):
        if not mesh.file:
            continue
        # MuJoCo names a mesh after its file, which changes here.
        mesh.name = mesh.name or Path(mesh.file).stem
        name = Path(mesh.file).name if spec.strippath else mesh.file
        path = find_mesh(name, folder, roots) if keep else None
        data = read_mesh(path, assets) if path else None
        if path is None or data is None:
            absent[mesh.name] = Path(mesh.file).name
            spec.delete(mesh)
        else:
            token = mesh_token(i, path)
            mesh.file, assets[token] = token, data
    spec.meshdir = ""
    spec.assets = assets
    return absent
