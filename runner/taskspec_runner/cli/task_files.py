"""The task files among paths that a command is given."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import field
from pathlib import Path

from taskspec.deferred_methods import dataclass
from taskspec_runner.cli.given import STDIN
from taskspec_runner.errors import InputError
from taskspec_runner.record.names import has_results

_SUFFIXES = (".yaml", ".yml")
#: A line that may give a task its stages, or name files that are included.
_STAGES = re.compile(rb"^(?:[^#\n]*[{,\s])?[\"']?stages[\"']?\s*:", re.M)
_INCLUDE = re.compile(rb"\binclude\b")


@dataclass(frozen=True, slots=True)
class TaskFiles:
    """Task files, and what of the folders could not be read.

    Attributes:
        files: each once, in order.
        unread: folders, each with why.
    """

    files: list[Path] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)


def task_files(paths: Sequence[Path]) -> TaskFiles:
    """The files among the paths, and the YAML files below the folders among them, each once.

    Hidden folders are passed over, and so are those of runs, comparisons and sweeps: what they
    hold is a copy. A file without stages that a task beside it includes is no task; in its place,
    where it is named itself, come the tasks beside it that include it. A folder below the named
    ones that cannot be listed, or a link that leads nowhere, keeps none of the others back.

    Raises:
        InputError: a folder has none, or cannot be listed, or standard input is not alone.
    """
    if STDIN in paths and len(paths) > 1:
        raise InputError("'-' stands for standard input, and for nothing beside it")
    found, named = TaskFiles(), set[str]()
    for path in paths:
        if not path.is_dir():
            found.files.append(path)
            named.add(os.path.realpath(path))
            continue
        below = TaskFiles()
        _list(path, below, set())
        if not below.files and below.unread:
            raise InputError(f"cannot read {below.unread[0]}")
        found.files.extend(below.files)
        found.unread.extend(below.unread)
        if not below.files:
            raise InputError(f"there is no task file in {path}")
    tasks = _tasks(_once(found.files), named) if paths != [STDIN] else list(paths)
    if not tasks:
        raise InputError(f"there is no task file in {', '.join(map(str, paths))}")
    return TaskFiles(tasks, found.unread)


def _once(files: Iterable[Path]) -> list[Path]:
    """Files by where they lead, the first name of each."""
    named: dict[str, Path] = {}
    for file in files:
        named.setdefault(os.path.realpath(file), file)
    return [*named.values()]


def _list(folder: Path, into: TaskFiles, seen: set[str]) -> None:
    """The YAML files below a folder; a folder that was seen, as a link leads to it, adds none."""
    real = os.path.realpath(folder)
    if real in seen:
        return
    seen.add(real)
    try:
        entries = [] if has_results(folder) else sorted(folder.iterdir())
    except OSError as error:
        into.unread.append(f"{folder}: {error.strerror or error}")
        return
    for entry in entries:
        if entry.name.startswith("."):
            continue
        if entry.is_dir():
            _list(entry, into, seen)
        elif entry.suffix in _SUFFIXES:
            into.files.append(entry)


def _tasks(files: list[Path], named: set[str]) -> list[Path]:
    """Files without those that only others include."""
    suspected = [file for file in files if not _may_have_stages(file)]
    if not suspected:
        return files
    beside = [
        each
        for folder in dict.fromkeys(file.parent for file in suspected)
        for each in sorted(folder.iterdir())
        if each.suffix in _SUFFIXES and each.is_file()
    ]
    includes = {os.path.realpath(file): _includes(file) for file in _once([*files, *beside])}
    others = {real: {part for part in parts if part != real} for real, parts in includes.items()}
    parts = {os.path.realpath(file) for file in suspected} & set().union(*others.values())
    found: list[Path] = []
    for file in files:
        real = os.path.realpath(file)
        if real not in parts:
            found.append(file)
        elif real in named:
            users = (each for each in beside if real in _reached(os.path.realpath(each), includes))
            found += [each for each in users if _may_have_stages(each)]
    return _once(found)


def _reached(real: str, includes: Mapping[str, set[str]]) -> set[str]:
    """What a file includes, itself or through what it includes."""
    found, waiting = set[str](), [real]
    while waiting:
        new = includes.get(waiting.pop(), set()) - found
        found |= new
        waiting.extend(new)
    return found


def _may_have_stages(file: Path) -> bool:
    """Whether a file is read as a task; one that cannot be read says so itself."""
    content = _content(file)
    return content is None or _STAGES.search(content) is not None


def _includes(file: Path) -> set[str]:
    """Where the files lie that a file includes."""
    content = _content(file)
    if content is None or not _INCLUDE.search(content):
        return set()
    from taskspec.spec.include import KEY
    from taskspec.text import nodes
    from taskspec.text.characters import normal
    from taskspec.text.diagnostic import Diagnostics
    from taskspec.text.source import Source
    from taskspec.text.yaml import read

    text = normal(content.decode("utf-8", "replace"))
    root = read(Source(str(file), text), Diagnostics(str(file)))
    given = root.get(KEY) if isinstance(root, nodes.Mapping) else None
    entries = given.items if isinstance(given, nodes.Sequence) else [given]
    values = (each.value for each in entries if isinstance(each, nodes.Scalar))
    return {os.path.realpath(file.parent / value) for value in values if "\0" not in value}


def _content(file: Path) -> bytes | None:
    """The bytes of a file as far as a task may be long; None where it is none to be read."""
    from taskspec.regular_file import open_regular
    from taskspec.text.yaml import MAX_BYTES

    try:
        with open_regular(file) as stream:
            return stream.read(MAX_BYTES + 1)
    except (OSError, ValueError):
        return None


__all__ = ["TaskFiles", "task_files"]
