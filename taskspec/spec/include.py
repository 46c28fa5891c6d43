"""`include`: files that bring robot, world, params, frames and templates that tasks share.

What is included is read into the tree of the task, each part with its place in its own file and the
line that brought it. Files lie in the project of the task, as all that it names.
"""

from __future__ import annotations

import hashlib
import os.path
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any

from taskspec.spec.field_type import FieldType
from taskspec.spec.parse_context import ParseContext
from taskspec.text import nodes
from taskspec.text.characters import normal
from taskspec.text.codes import register
from taskspec.text.confines import OUTSIDE, REMEDY, Confines, confines, here
from taskspec.text.diagnostic import Diagnostics, Note
from taskspec.text.nodes import Mapping as MappingNode
from taskspec.text.nodes import Node, Scalar, Sequence
from taskspec.text.origin import Origin
from taskspec.text.source import Source, Span
from taskspec.text.suggest import closest
from taskspec.text.yaml import MAX_BYTES, read

register({"TS133": "a file that cannot be included"})

KEY = "include"
SECTIONS = ("robot", "world", "params", "frames", "templates")
"""What a file that is included may bring; the entries of each are put together by name."""
_ALLOWED = ("taskspec", "about", KEY, *SECTIONS)
_ENDINGS = (".yaml", ".yml")
MAX_FILES = 32
#: Keys whose value may be the path of a file, with what they hang on.
_PATHS = (("robot", "model"), ("robot", "protection"), ("robot", "servo"), ("path", "file"))


class Included(FieldType):
    """Files to include; they are read with the text of the task."""

    def read(self, value: object, context: ParseContext) -> tuple[str, ...]:  # noqa: ARG002
        """The paths as written."""
        return tuple(map(str, value)) if isinstance(value, list) else (str(value),)

    def json(self) -> dict[str, Any]:
        """Describes one path or a list of them."""
        path = {"type": "string", "pattern": r"\.ya?ml$"}
        return {"anyOf": [path, {"type": "array", "minItems": 1, "items": path}]}


class Inclusion:
    """Reads the files that a task includes into its tree.

    Attributes:
        files: SHA-256 of every file that was read, by its absolute path.
        missing: whether a file could not be read, so that what it brings is not known.
    """

    def __init__(
        self, name: str, base: Path | None, sources: dict[str, Source], found: Diagnostics
    ) -> None:
        """Begins for one task.

        Args:
            name: of its text, as it is shown.
            base: its folder; None is the working directory.
            sources: texts by name; those that are read are added.
            found: where findings go.
        """
        self._base = base if base is not None else Path()
        self._folder = PurePath(name).parent
        self._confines: Confines = confines(base)
        self._sources, self._found = sources, found
        self._own = os.path.realpath(self._base / PurePath(name).name)
        self.files: dict[Path, str] = {}
        self.missing = False

    def into(self, root: MappingNode) -> None:
        """Puts together a task and what it includes; the tree is changed in place."""
        self._include(root, PurePath(), (self._own,))

    def note(self, path: Path, digest: str) -> None:
        """Takes note of another file that was read for the task, with its SHA-256."""
        self.files[Path(os.path.normpath(path.absolute()))] = digest

    def shown(self, name: str) -> str:
        """A path from the folder of the task, as its text is shown."""
        return os.path.normpath(self._folder / name)

    def _include(self, root: MappingNode, folder: PurePath, chain: tuple[str, ...]) -> None:
        """Includes what a file names; `folder` is its own, from that of the task."""
        brought: list[MappingNode] = []
        for entry in self._entries(root):
            part = self._file(entry, folder, chain)
            if part is not None:
                brought.append(part)
        for section in SECTIONS:
            self._join(root, section, [part for part in brought if section in part.entries])

    def _entries(self, root: MappingNode) -> Iterator[Scalar]:
        given = root.get(KEY)
        if given is None:
            return
        entries = given.items if isinstance(given, Sequence) else [given]
        if isinstance(given, Sequence) and not entries and not given.broken:
            self._found.error("TS023", "this list is empty", nodes.pointer(given))
        for entry in entries:
            if isinstance(entry, Scalar) and not entry.empty:
                yield entry
            elif not isinstance(entry, Scalar):
                kind = "a list" if isinstance(entry, Sequence) else "a mapping"
                self._found.error("TS022", f"'include' names files, this is {kind}",
                                  nodes.pointer(entry), "include: [cell.yaml]")  # fmt: skip

    def _file(self, entry: Scalar, folder: PurePath, chain: tuple[str, ...]) -> MappingNode | None:
        """The tree of one file with what it includes itself; None where there is none to add."""
        path = here(self._base / folder / entry.value)
        real = os.path.realpath(path) if "\0" not in entry.value else ""
        if not self._is_sound(entry, path, real, chain):
            return None
        absolute = Path(os.path.normpath(path.absolute()))
        if any(os.path.realpath(known) == real for known in self.files):
            return None  # It is there already, through another file.
        if len(self.files) >= MAX_FILES:
            self._error(entry, f"more than {MAX_FILES} files", "put some of them together")
            return None
        try:
            with path.open("rb") as stream:
                content = stream.read(MAX_BYTES + 1)
            text = content.decode("utf-8")
        except OSError as error:
            self._error(entry, f"cannot read '{entry.value}': {error.strerror or error}", "")
            return None
        except UnicodeDecodeError as error:
            if len(content) <= MAX_BYTES:
                message = f"'{entry.value}' is not UTF-8 (byte {error.start})"
                self._error(entry, message, "save it as UTF-8")
                return None
            text = " " * (MAX_BYTES + 1)
        self.files[absolute] = hashlib.sha256(content).hexdigest()
        shown = os.path.normpath(self._folder / folder / entry.value)
        source = Source(shown, normal(text))
        self._sources[shown] = source
        note = ("included here", nodes.pointer(entry))
        inner = Diagnostics(shown)
        tree = read(source, inner)
        notes = tuple(Note(words, span.source or self._found.source, span)
                      for words, span in (note, *note[1].via))  # fmt: skip
        self._found.extend(replace(d, notes=(*d.notes, *notes)) for d in inner.sorted())
        if not isinstance(tree, MappingNode):
            self.missing = True
            return None
        Moved(shown, note).move(tree)
        for key, (name, _) in list(tree.entries.items()):
            if key not in _ALLOWED:
                self._found.error(
                    "TS020", f"unknown key '{key}' in a file that is included", name.span,
                    f"it may bring {', '.join(SECTIONS)}, and include others")  # fmt: skip
        version = tree.get("taskspec")
        if version is not None and not (isinstance(version, Scalar) and version.value == "1"):
            self._found.error("TS024", "this version of the language is not known",
                              nodes.pointer(version), "write taskspec: 1")  # fmt: skip
        inside = PurePath(os.path.normpath(folder / PurePath(entry.value).parent))
        if not PurePath(entry.value).is_absolute():
            _rebase(tree, inside, ())
        self._include(tree, inside, (*chain, real))
        return tree

    def _is_sound(self, entry: Scalar, path: Path, real: str, chain: tuple[str, ...]) -> bool:
        """Whether a file may be included; reported where not."""
        shown = f"'{entry.value}'"
        if not entry.value.lower().endswith(_ENDINGS) or not real:
            self._error(entry, f"{shown} is no YAML file by its ending",
                        f"known endings are {', '.join(_ENDINGS)}")  # fmt: skip
        elif not self._confines.hold(path):
            self.missing = True
            self._found.error(OUTSIDE, f"{shown} lies outside of the task's project",
                              nodes.pointer(entry), REMEDY)  # fmt: skip
        elif real in chain:
            names = [PurePath(each).name for each in (*chain[chain.index(real) :], real)]
            self._error(entry, f"files that include each other: {' -> '.join(names)}",
                        "put what both need into a third one")  # fmt: skip
        elif not os.path.lexists(path):
            self._error(entry, f"there is no file {shown}", _nearest(entry.value, path))
        elif not path.is_file():
            self._error(entry, f"{shown} is no regular file", "name a YAML file")
        else:
            return True
        return False

    def _join(self, root: MappingNode, section: str, brought: list[MappingNode]) -> None:
        """Puts the entries of a section before those of a file's own."""
        if not brought:
            return
        own = root.entries.get(section)
        parts = [part.entries[section] for part in brought] + ([own] if own is not None else [])
        if len(parts) == 1:
            root.entries[section] = parts[0]
            return
        key, last = parts[-1]
        entries: dict[str, tuple[Scalar, Node]] = {}
        broken = False
        for _, part in parts:
            if not isinstance(part, MappingNode):
                self._found.error("TS022", f"'{section}' is a mapping, this is not",
                                  nodes.pointer(part))  # fmt: skip
                continue
            broken = broken or part.broken
            for name, entry in part.entries.items():
                if name in entries:
                    self._found.error("TS126", f"'{name}' is given in two files", entry[0].span,
                                      "keep one of the two",
                                      (("first given here", entries[name][0].span),))  # fmt: skip
                else:
                    entries[name] = entry
        flow = isinstance(last, MappingNode) and last.flow
        root.entries[section] = (key, MappingNode(last.span, flow, entries, broken))

    def _error(self, entry: Scalar, message: str, hint: str) -> None:
        self.missing = True
        self._found.error("TS133", message, nodes.pointer(entry), hint)


class Moved:
    """Moves the places of a tree to the text that it was read from."""

    def __init__(self, source: str, note: tuple[str, Span]) -> None:
        self._source, self._note = source, note

    def move(self, node: Node) -> None:
        """Changes a tree in place."""
        if isinstance(node, Scalar):
            o = node.origin
            node.origin = Origin(self._span(o.span), o.value, o.raw, o.skip)
            return
        node.span = self._span(node.span)
        below = node.items if isinstance(node, Sequence) else [
            part for entry in node.entries.values() for part in entry]  # fmt: skip
        for part in below:
            self.move(part)

    def _span(self, span: Span) -> Span:
        return replace(span, source=self._source).reached(*self._note)


def _rebase(node: Node, folder: PurePath, keys: tuple[str, ...]) -> None:
    """Makes paths that count from a file's folder count from that of the task."""
    if isinstance(node, MappingNode):
        for key, (_, value) in node.entries.items():
            _rebase(value, folder, (*keys, key))
    elif isinstance(node, Sequence):
        for item in node.items:
            _rebase(item, folder, keys)
    elif _names_file(keys) and _is_path(node.value):
        o = node.origin
        node.value = str(folder / node.value)
        node.origin = Origin(o.span, node.value, o.raw, o.skip)


def _names_file(keys: tuple[str, ...]) -> bool:
    """Whether a key may be the path of a file."""
    return keys[-2:] in _PATHS or (keys[:1] == ("world",) and keys[2:] == ("file",))


def _is_path(value: str) -> bool:
    """Whether a value is a path of a file; PACKAGE:NAME, with parts of a path in it, is none."""
    return any(mark in value for mark in "/\\.") and ":" not in value


def shown_from(source: str, task: str) -> str:
    """The name of a text as the task file names it; an option is no file and stays as it is."""
    if not source.lower().endswith(_ENDINGS):
        return source
    return PurePath(os.path.relpath(source, PurePath(task).parent)).as_posix()


def _nearest(written: str, path: Path) -> str:
    """What to write instead of a path at which there is no file."""
    there = sorted(each.name for each in path.parent.glob("*") if each.suffix in _ENDINGS)
    near = closest(path.name, there)
    if near is None:
        return "paths are relative to the file that includes"
    return f"did you mean '{written.removesuffix(path.name)}{near}'?"
