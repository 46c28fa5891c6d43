"""A task file with everything that it reads: what a worker needs, wherever it runs."""

from __future__ import annotations

import atexit
import hashlib
import os
import shutil
import tempfile
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path, PurePosixPath

from taskspec.compiler import compile_task, compile_unchecked
from taskspec.deferred_methods import dataclass
from taskspec.program.program import Program
from taskspec.spec import load_task
from taskspec.text.confines import moved
from taskspec_runner.errors import InputError
from taskspec_runner.record import manifest

#: Tasks that a worker keeps compiled.
_KEPT = 2


@dataclass(frozen=True)
class Bundle:
    """A task file and what it reads, by their places relative to each other.

    Attributes:
        root: that all of them lie below where it was made.
        file: the task file, relative to that.
        contents: of every file, by its path from the root.
        overrides: dotted path to YAML text.
        force: whether findings are lifted behind which it still compiles.
        versions: that its numbers depend on, where it was made.
    """

    root: str
    file: str
    contents: Mapping[str, bytes]
    overrides: Mapping[str, str]
    force: bool
    versions: Mapping[str, str]

    @staticmethod
    def of(program: Program) -> Bundle:
        """The bundle of a compiled task.

        Raises:
            InputError: a file cannot be read any more.
        """
        loaded = program.context.loaded
        base = _plain((loaded.base or Path()).absolute())
        task = base / (loaded.path.name if loaded.path is not None else "task.yaml")
        contents = {task: manifest.task_bytes(loaded)}
        for path in manifest.input_files(program):
            try:
                contents[_plain(path)] = path.read_bytes()
            except OSError as error:
                raise InputError(f"{path} cannot be read any more: {error.strerror}") from error
        root = Path(os.path.commonpath([path.parent for path in contents]))
        placed = {path.relative_to(root).as_posix(): text for path, text in contents.items()}
        return Bundle(
            str(root),
            task.relative_to(root).as_posix(),
            dict(sorted(placed.items())),
            dict(loaded.overrides),
            bool(program.forced),
            manifest.versions(),
        )

    @cached_property
    def key(self) -> str:
        """SHA-256 of all of it, wherever it was."""
        digest = hashlib.sha256(repr((self.file, self.force)).encode())
        for part in (*self.contents.items(), *sorted(self.overrides.items())):
            digest.update(repr(part).encode())
        digest.update(repr(sorted(self.versions.items())).encode())
        return digest.hexdigest()

    def check_versions(self) -> None:
        """Finds out whether its numbers would be the same here.

        Raises:
            InputError: something else is installed here than where it was made.
        """
        here = manifest.versions()
        others = [
            f"{name} {here.get(name, 'is missing')} instead of {version}"
            for name, version in self.versions.items()
            if here.get(name) != version
        ]
        if others:
            raise InputError(f"a worker has {', '.join(others)}: install the same versions there")


_programs: dict[str, Program] = {}
#: Of those, which have been examined.
_examined: set[str] = set()


def program_of(bundle: Bundle, *, examined: bool = False) -> Program:
    """The compiled task of a bundle; compiled once a process.

    Args:
        bundle: of a task that its sender has examined.
        examined: whether the program is to have what was found about it, which takes longer.

    Raises:
        InputError: other versions are installed here.
        SpecError: the task does not compile here.
    """
    if bundle.key not in _programs or (examined and bundle.key not in _examined):
        bundle.check_versions()
        _programs.pop(bundle.key, None)
        while len(_programs) >= _KEPT:
            oldest = next(iter(_programs))
            del _programs[oldest]
            _examined.discard(oldest)
        folder = _unpacked(bundle)
        with moved(Path(bundle.root), folder):
            loaded = load_task(folder / PurePosixPath(bundle.file), dict(bundle.overrides))
            if examined:
                _programs[bundle.key] = compile_task(loaded, force=bundle.force)
                _examined.add(bundle.key)
            else:
                _programs[bundle.key] = compile_unchecked(loaded)
    return _programs[bundle.key]


def keep_program(bundle: Bundle, program: Program) -> None:
    """Lets workers in this process use a program that is compiled already."""
    _programs[bundle.key] = program
    _examined.add(bundle.key)


def _plain(path: Path) -> Path:
    """A path without steps up, as these are from folders that a bundle need not have."""
    return Path(os.path.normpath(path))


def _unpacked(bundle: Bundle) -> Path:
    """The folder that has its files as they lay below its root."""
    folder = Path(tempfile.mkdtemp(prefix="taskspec-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    for name, content in bundle.contents.items():
        path = folder / PurePosixPath(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    # What it reads may lie beside and above the task file: all of it is one project.
    (folder / ".git").touch()
    return folder
