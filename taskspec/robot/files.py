"""Reading a robot's files: what may be opened, and how large it may be."""

from __future__ import annotations

import re
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import field
from hashlib import sha256
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from taskspec.deferred_methods import dataclass
from taskspec.robot.bounds import MOST_DEPTH, MOST_ELEMENTS, check_text, too_large
from taskspec.robot.collada import as_obj
from taskspec.robot.errors import RobotError
from taskspec.text.codes import register
from taskspec.text.confines import REMEDY, Confines

register(
    {
        "TS401": "an unknown robot",
        "TS402": "a robot file that cannot be read",
    }
)

SUFFIXES = (".xml", ".mjcf", ".urdf", ".xacro")
MESH_SUFFIXES = (".stl", ".obj", ".msh", ".dae")

_MODEL_BYTES = 8 * 2**20
_MESH_BYTES = 64 * 2**20
_ALL_MESHES = 256 * 2**20
_NAN = re.compile(r"(?:^|\s)[+-]?nan(?:\s|$)", re.IGNORECASE)
_NAMES = frozenset(
    {"name", "class", "childclass", "link", "joint", "body", "site", "file", "filename"}
)


@dataclass(slots=True)
class Noted:
    """The files that a robot is made of.

    Attributes:
        files: SHA-256 of every file that was read, by its path.
        absent: paths at which none was.
        whole: whether this is all; a program that expands a file searches where it likes.
    """

    files: dict[Path, str] = field(default_factory=dict)
    absent: set[Path] = field(default_factory=set)
    whole: bool = True


_NOTED: ContextVar[Noted | None] = ContextVar("noted", default=None)


@contextmanager
def noting_files() -> Iterator[Noted]:
    """Notes every file of a robot that is read or searched meanwhile."""
    noted = Noted()
    token = _NOTED.set(noted)
    try:
        yield noted
    finally:
        _NOTED.reset(token)


def note_program() -> None:
    """Notes that a program reads files of a robot, which may be others another time."""
    if (noted := _NOTED.get()) is not None:
        noted.whole = False


@dataclass(frozen=True, slots=True)
class Roots:
    """Folders of a robot's file and of the files that it may include.

    Attributes:
        model: The folder of the robot's file.
        confines: The folders below which all files of the task lie.
    """

    model: Path
    confines: Confines

    def hold(self, path: Path) -> bool:
        """Whether the file that `path` really is lies below one of the folders."""
        return self.confines.hold(path)


def is_regular(path: Path) -> bool:
    """Whether there is a regular file; a path that no system can have names none."""
    try:
        there = path.is_file()
    except (OSError, ValueError):
        return False
    if not there and (noted := _NOTED.get()) is not None:
        noted.absent.add(path.absolute())
    return there


def looks_like_path(model: str) -> bool:
    """Whether `robot.model` means a file rather than a built-in robot."""
    return any(mark in model for mark in "/\\.")


def read_model(path: Path, shown: str, confines: Confines) -> str:
    """The text of a robot's file.

    Args:
        path: Where it is.
        shown: How the user wrote it.
        confines: Where it may lie.

    Raises:
        RobotError: TS401 when there is none, TS402 when it is not a regular text file of a known
            kind, TS409 when it lies elsewhere.
    """
    if not {path.suffix.lower(), _real_suffix(path)} <= set(SUFFIXES):
        raise RobotError(
            "TS402",
            f"'{shown}' is neither MJCF nor URDF by its ending",
            f"known endings are {', '.join(SUFFIXES)}",
        )
    if not confines.hold(path):
        raise RobotError("TS409", f"'{shown}' lies outside of the task's project", REMEDY)
    data = _read(path, shown, _MODEL_BYTES)
    if data is None:
        raise RobotError(
            "TS401", f"there is no file '{shown}'", f"paths are relative to the task file: {path}"
        )
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise RobotError(
            "TS402", f"'{shown}' is not UTF-8 text (byte {error.start})", "save it as UTF-8"
        ) from None


def _real_suffix(path: Path) -> str:
    """The ending of the file that a link leads to; that of the path where it leads nowhere."""
    real = path.resolve() if is_regular(path) else path
    return real.suffix.lower()


def read_mesh(path: Path, others: Mapping[str, bytes]) -> bytes | None:
    """The bytes of a mesh; None where it is absent, too large or of a kind that is not drawn.

    Those of a COLLADA file are given as OBJ; see `mesh_token`.

    Args:
        path: Where it is.
        others: What has been read before, with which it may not come to too much.
    """
    if path.suffix.lower() not in MESH_SUFFIXES:
        return None
    try:
        room = _ALL_MESHES - sum(map(len, others.values()))
        data = _read(path, path.name, min(_MESH_BYTES, room))
    except RobotError:
        return None
    return as_obj(data) if data and path.suffix.lower() == ".dae" else data


def read_part(path: Path, shown: str) -> None:
    """Notes a file that something else has read for the robot; see `noting_files`.

    Raises:
        RobotError: TS402 when it is not a regular file, or too large.
    """
    _read(path, shown, _MODEL_BYTES)


def mesh_token(number: int, path: Path) -> str:
    """A name for the bytes of a mesh, with the ending of what they are."""
    suffix = path.suffix.lower()
    return f"mesh{number}{'.obj' if suffix == '.dae' else suffix}"


def parse_xml(text: str, shown: str, *, placed: bool = True) -> ElementTree.Element:
    """The elements of a robot's file.

    Args:
        text: Of the file.
        shown: The file as the user wrote it.
        placed: Whether lines of the text are lines of that file; see `line_of`.

    Raises:
        RobotError: TS402 when it is not XML; TS403 when it defines a document type, is too deep,
            has too many elements or a NaN.
    """
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise RobotError("TS403", f"'{shown}' defines a document type", "remove the <!DOCTYPE …>")
    check_text(text, shown)
    builder = ElementTree.TreeBuilder(element_factory=_Placed)
    parser = expat.ParserCreate(namespace_separator="}")
    parser.buffer_text = True

    def begin(tag: str, attributes: dict[str, str]) -> None:
        element = builder.start(_qualified(tag), {_qualified(k): v for k, v in attributes.items()})
        if placed and isinstance(element, _Placed):
            element.file, element.line = shown, parser.CurrentLineNumber

    parser.StartElementHandler, parser.CharacterDataHandler = begin, builder.data
    parser.EndElementHandler = lambda tag: builder.end(_qualified(tag))
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise RobotError(
            "TS402",
            f"'{shown}' is not well-formed XML: line {error.lineno}, column {error.offset + 1}",
            expat.errors.messages[error.code],
        ) from None
    root = builder.close()
    check_size(root, shown)
    return root


class _Placed(ElementTree.Element):
    """An element that knows where it was written."""

    file = ""
    line = 0


def _qualified(name: str) -> str:
    """A name as ElementTree has it, of one as expat gives it."""
    return f"{{{name}" if "}" in name else name


def line_of(element: ElementTree.Element, shown: str) -> str:
    """Where an element is written, as the end of a phrase; empty where nobody knows.

    Args:
        element: Of a robot's file.
        shown: The file, which is named where the element is in one that it includes.
    """
    if not isinstance(element, _Placed) or not element.line:
        return ""
    return f" ({element.file or shown}, line {element.line})"


def on_one_line(root: ElementTree.Element) -> str:
    """The text of elements that were changed, whose line numbers would say nothing."""
    return " ".join(ElementTree.tostring(root, encoding="unicode").split())


def check_size(root: ElementTree.Element, shown: str) -> None:
    """Refuses elements that are too deep or too many, and numbers that are none.

    Raises:
        RobotError: TS403 or TS405.
    """
    level, depth, count = [root], 0, 0
    while level:
        depth, count = depth + 1, count + len(level)
        if depth > MOST_DEPTH or count > MOST_ELEMENTS:
            raise too_large(shown, count, depth)
        for element in level:
            for key, value in element.attrib.items():
                if key not in _NAMES and _NAN.search(value):
                    name = element.get("name")
                    tag = f"<{element.tag} name='{name}'>" if name else f"<{element.tag}>"
                    raise RobotError(
                        "TS405", f"'{shown}' has a NaN: {key} of {tag}", "write the number"
                    )
        level = [child for element in level for child in element]


def _read(path: Path, shown: str, limit: int) -> bytes | None:
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise RobotError("TS402", f"'{shown}' is not a regular file")
        if status.st_size > limit:
            raise RobotError(
                "TS402",
                f"'{shown}' has {status.st_size / 2**20:.1f} MiB, more than {limit // 2**20} MiB",
                "leave the arm alone in it",
            )
        content = path.read_bytes()
        if (noted := _NOTED.get()) is not None:
            noted.files[path.absolute()] = sha256(content).hexdigest()
        return content
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise RobotError("TS402", f"'{shown}' cannot be read: {reason}") from None
