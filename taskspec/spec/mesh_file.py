"""`world.OBJECT.file`: the meshes that a task names, found beside it."""

from __future__ import annotations

from pathlib import Path

from taskspec.shapes.mesh import SUFFIXES
from taskspec.spec.include import Inclusion
from taskspec.store import digest_of
from taskspec.text import nodes
from taskspec.text.codes import register
from taskspec.text.confines import OUTSIDE, REMEDY, confines, here
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Mapping, Scalar
from taskspec.text.origin import Origin

register({"TS333": "a mesh that cannot be touched"})

#: Larger files are no parts [bytes].
_LARGEST = 64 * 2**20


def find_meshes(root: Mapping, base: Path | None, inclusion: Inclusion, found: Diagnostics) -> None:
    """Has the files of meshes count from the working directory; reports those that are not there.

    Args:
        root: tree of the task, changed in place.
        base: its folder; None is the working directory.
        inclusion: what else is read for the task, to which they are added.
        found: where findings go.
    """
    world = root.get("world")
    for _, thing in world.entries.values() if isinstance(world, Mapping) else ():
        entry = thing.get("file") if isinstance(thing, Mapping) else None
        if not isinstance(entry, Scalar) or entry.empty:
            continue
        name, span = entry.value, nodes.pointer(entry)
        path = here((base or Path()) / name)
        if not name.lower().endswith(SUFFIXES):
            hint = f"known endings are {', '.join(SUFFIXES)}"
            found.error("TS333", f"'{name}' is no mesh by its ending", span, hint)
        elif "\0" in name or not confines(base).hold(path):
            found.error(OUTSIDE, f"'{name}' lies outside of the task's project", span, REMEDY)
        elif not path.is_file():
            hint = f"paths are relative to the task file: {path}"
            found.error("TS333", f"there is no file '{name}'", span, hint)
        elif path.stat().st_size > _LARGEST:
            hint = "export it coarser, or as binary STL"
            found.error("TS333", f"'{name}' is larger than {_LARGEST >> 20} MiB", span, hint)
        elif (digest := digest_of(path)) is None:
            found.error("TS333", f"'{name}' cannot be read", span, "see to its permissions")
        else:
            inclusion.note(path, digest)
            entry.origin = Origin(entry.origin.span, str(path), entry.origin.raw, entry.origin.skip)
            entry.value = str(path)
