"""Which files a task may name: those of its project, and of folders that the user has opened."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from taskspec.deferred_methods import dataclass
from taskspec.text.codes import register

register({"TS409": "a file outside of the task's project"})

VARIABLE = "TASKSPEC_FILES"
"""Environment variable with further folders whose files a task may name, as in PATH."""
OUTSIDE = "TS409"
"""Code of a file that lies elsewhere."""
REMEDY = (
    "keep it below the folder with .git or pyproject.toml, or the task's own where there is none; "
    f"or name its folder in the environment variable {VARIABLE}"
)
"""What to do about a file outside of them."""
_REPOSITORY = (".git", ".hg")
_PACKAGE = ("pyproject.toml", "package.xml")


@dataclass(frozen=True, slots=True)
class Confines:
    """Folders below which a task's files lie, links followed."""

    folders: tuple[Path, ...]

    def hold(self, path: Path) -> bool:
        """Whether the file that `path` really is lies below one of the folders."""
        try:
            real = path.resolve()
        except (OSError, ValueError, RuntimeError):
            return True  # Nothing can be read there, which is reported when that is tried.
        return any(real.is_relative_to(folder) for folder in self.folders)


def confines(base: Path | None) -> Confines:
    """The folders for a task.

    Args:
        base: The folder of the task file; None is the working directory.
    """
    opened = os.environ.get(VARIABLE, "").split(os.pathsep)
    further = [Path(folder).expanduser().resolve() for folder in opened if folder.strip()]
    return Confines((project(base or Path.cwd()), *further))


_MOVED: ContextVar[tuple[Path, Path] | None] = ContextVar("moved", default=None)


@contextmanager
def moved(root: Path, folder: Path) -> Iterator[None]:
    """Has files that are named by absolute paths below `root` be searched below `folder`."""
    token = _MOVED.set((root, folder))
    try:
        yield
    finally:
        _MOVED.reset(token)


def here(path: Path) -> Path:
    """Where a file lies that a task or one of its files names: elsewhere if they were moved."""
    found = _MOVED.get()
    if found is None:
        return path
    root, folder = found
    # Folders that hold none of the files were not moved with them.
    path = Path(os.path.normpath(path))
    if path.is_relative_to(folder) or not path.is_relative_to(root):
        return path
    return folder / path.relative_to(root)


def project(base: Path) -> Path:
    """The repository that a folder is in, else its package, else the folder itself."""
    folder = base.resolve()
    for marks in (_REPOSITORY, _PACKAGE):
        for above in (folder, *folder.parents):
            if any((above / mark).exists() for mark in marks):
                return above
    return folder
