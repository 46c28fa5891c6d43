"""`robot: {protection: NAME, servo: NAME}`: one that comes along, or one in a file of its own.

What it says takes the place of the name in the tree of the task, each part with its place in its
own file and the line that names it. Files lie in the project of the task, as all that it names.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import cache
from pathlib import Path

from taskspec.spec.include import Inclusion, Moved
from taskspec.text import nodes
from taskspec.text.characters import normal
from taskspec.text.codes import register
from taskspec.text.confines import OUTSIDE, REMEDY, confines, here
from taskspec.text.diagnostic import Diagnostics, Note
from taskspec.text.nodes import Mapping as MappingNode
from taskspec.text.nodes import Scalar
from taskspec.text.source import Source
from taskspec.text.suggest import suggestion
from taskspec.text.yaml import MAX_BYTES, read

register({"TS134": "a protection or a servo that cannot be read"})

#: Keys of the robot that may name a file, and where those that come along lie.
_FOLDERS = {
    key: Path(__file__).parent / folder
    for key, folder in (("protection", "protections"), ("servo", "servos"))
}
_ENDINGS = (".yaml", ".yml")


@cache
def built_in(key: str) -> tuple[str, ...]:
    """The names that `robot.protection` or `robot.servo` may say."""
    return tuple(sorted(path.stem for path in _FOLDERS[key].glob("*.yaml")))


class RobotFiles:
    """Reads the protection and the servo that a task names into its tree."""

    def __init__(
        self,
        base: Path | None,
        sources: dict[str, Source],
        found: Diagnostics,
        inclusion: Inclusion,
    ) -> None:
        """Begins for one task.

        Args:
            base: its folder; None is the working directory.
            sources: texts by name; the one that is read is added.
            found: where findings go.
            inclusion: what else is read for the task, to which the file is added.
        """
        self._base, self._sources, self._found = base, sources, found
        self._inclusion = inclusion

    def into(self, root: MappingNode) -> bool:
        """Puts what files say in the place of their names; whether nothing is amiss."""
        return all([self._one(root, key) for key in _FOLDERS])

    def _one(self, root: MappingNode, name: str) -> bool:
        robot = root.get("robot")
        entry = robot.entries.get(name) if isinstance(robot, MappingNode) else None
        if entry is None:
            return True
        key, named = entry
        if not isinstance(named, Scalar) or named.empty:
            return True
        read_in = self._text(name, named)
        if read_in is None:
            return False
        self._sources[read_in.name] = read_in
        note = ("named here", nodes.pointer(named))
        inner = Diagnostics(read_in.name)
        tree = read(read_in, inner)
        notes = tuple(
            Note(words, span.source or self._found.source, span)
            for words, span in (note, *note[1].via)
        )
        self._found.extend(replace(d, notes=(*d.notes, *notes)) for d in inner.sorted())
        if not isinstance(tree, MappingNode):
            return False
        Moved(read_in.name, note).move(tree)
        assert isinstance(robot, MappingNode)
        robot.entries[name] = (key, tree)
        return True

    def _text(self, key: str, named: Scalar) -> Source | None:
        name = named.value
        if name in built_in(key):
            text = (_FOLDERS[key] / f"{name}.yaml").read_text(encoding="utf-8")
            return Source(f"{name} (built in)", normal(text))
        if not name.lower().endswith(_ENDINGS):
            near = suggestion(name, built_in(key), "names")
            self._error(named, f"there is no {key} '{name}'",
                        f"{near}; or name a YAML file of your own")  # fmt: skip
            return None
        path = here((self._base or Path()) / name)
        if "\0" in name or not confines(self._base).hold(path):
            self._found.error(OUTSIDE, f"'{name}' lies outside of the task's project",
                              nodes.pointer(named), REMEDY)  # fmt: skip
            return None
        try:
            if not path.is_file():
                hint = "paths are relative to the task file"
                self._error(named, f"there is no file '{name}'", hint)
                return None
            with path.open("rb") as stream:
                content = stream.read(MAX_BYTES + 1)
            text = content.decode("utf-8") if len(content) <= MAX_BYTES else " " * (MAX_BYTES + 1)
        except OSError as error:
            self._error(named, f"cannot read '{name}': {error.strerror or error}")
            return None
        except UnicodeDecodeError as error:
            self._error(named, f"'{name}' is not UTF-8 (byte {error.start})", "save it as UTF-8")
            return None
        self._inclusion.note(path, hashlib.sha256(content).hexdigest())
        return Source(self._inclusion.shown(name), normal(text))

    def _error(self, named: Scalar, message: str, hint: str = "") -> None:
        self._found.error("TS134", message, nodes.pointer(named), hint)
