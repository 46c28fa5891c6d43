"""Files that a robot names by a package of ROS: beside it, in a workspace, or installed by pip."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from taskspec.robot.files import Roots, is_regular, note_program
from taskspec.text.confines import here

_MANIFEST = "package.xml"
_MANIFEST_BYTES = 2**16
_NAME = re.compile(rb"<name>\s*([^<]*?)\s*</name>")
_PARENTS = 8
#: Folders below one of ROS_PACKAGE_PATH in which a package is looked for.
_DEPTH = 3
#: Folders beside a file whose manifests are read.
_MOST_FOLDERS = 200


def find_package(name: str, roots: Roots) -> Path | None:
    """The folder of a package: None where it is nowhere.

    It is searched in the folders above the robot's file and beside these, as far as they may hold
    files of the task; then in ROS_PACKAGE_PATH and, below share, AMENT_PREFIX_PATH; then among the
    files of installed packages.

    Args:
        name: Of the package.
        roots: Of the robot's file.
    """
    if name in ("", ".", "..") or "/" in name or "\\" in name:
        return None
    for folder in _beside(name, roots):
        return folder
    return _in_environment(name) or next(_installed(name), None)


def find_mesh(uri: str, folder: Path, roots: Roots) -> Path | None:
    """The file that a mesh's URI means, or None.

    `package://NAME/rest` and `model://NAME/rest` are searched as `NAME/rest` and `rest` beside
    the robot's file and in the folders above it, as far as these may hold files of the task; then
    in the packages that the environment names.

    Args:
        uri: As written in the robot's file.
        folder: Where relative paths begin.
        roots: Where other files may lie.
    """
    scheme, _, rest = uri.rpartition("://")
    rest = rest.replace("\\", "/")
    if scheme in ("package", "model"):
        parts = Path(rest.lstrip("/")).parts
        if ".." in parts:
            return None
        above_model = roots.model.resolve().parents[:-1]
        for above in (roots.model, *above_model[:_PARENTS]):
            for relative in (parts, parts[1:]):
                file = above.joinpath(*relative)
                if relative and roots.hold(file) and is_regular(file):
                    return file
        package = _in_environment(parts[0]) if len(parts) > 1 else None
        elsewhere = None if package is None else package.joinpath(*parts[1:])
        return elsewhere if elsewhere is not None and is_regular(elsewhere) else None
    path = here(folder / rest)
    return path if roots.hold(path) and is_regular(path) else None


def _beside(name: str, roots: Roots) -> Iterator[Path]:
    """Where the project of a task may have it."""
    model = roots.model.resolve()
    above = [each for each in (model, *model.parents[:-1][:_PARENTS]) if roots.hold(each)]
    for folder in above:
        if folder.name == name or _names(folder, name):
            yield folder
        if (folder / name).is_dir():
            yield folder / name
    for folder in above:
        try:
            children = sorted(each for each in folder.iterdir() if each.is_dir())
        except OSError:
            continue
        yield from (each for each in children[:_MOST_FOLDERS] if _names(each, name))


def _in_environment(name: str) -> Path | None:
    """The package where a workspace that is sourced has it, which another time may be elsewhere."""
    prefixes, paths = _paths("AMENT_PREFIX_PATH"), _paths("ROS_PACKAGE_PATH")
    if prefixes or paths:
        note_program()
    shares = (prefix / "share" / name for prefix in prefixes)
    deeper = (
        manifest.parent
        for path in paths
        for depth in range(_DEPTH)
        for manifest in sorted(path.glob("*/" * depth + f"{name}/{_MANIFEST}"))
    )
    own = (path for path in paths if _names(path, name))
    found = (each for each in (*shares, *deeper, *own) if (each / _MANIFEST).is_file())
    return next(found, None)


def _paths(variable: str) -> list[Path]:
    return [Path(each) for each in os.environ.get(variable, "").split(os.pathsep) if each.strip()]


def _names(folder: Path, name: str) -> bool:
    """Whether a folder is a package of that name by its manifest."""
    try:
        with (folder / _MANIFEST).open("rb") as manifest:
            found = _NAME.search(manifest.read(_MANIFEST_BYTES))
    except OSError:
        return False
    return found is not None and found[1].decode(errors="replace") == name


def _installed(name: str) -> Iterator[Path]:
    """Folders of that name with files of a robot among those that pip has installed."""
    for distribution in metadata.distributions():
        for file in distribution.files or ():
            if name in file.parts[:-1] and file.suffix in (".xml", ".xacro", ".urdf", ".yaml"):
                path = Path(str(distribution.locate_file(file)))
                below = len(file.parts) - 1 - file.parts.index(name)
                yield path.parents[below - 1]
                break
