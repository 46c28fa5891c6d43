"""Paths as programs that run elsewhere understand them."""

from __future__ import annotations

import os
from pathlib import Path, PurePath
from urllib.parse import quote


def within(path: str, root: Path) -> PurePath | None:
    """The path relative to a folder, or None if it is not below it."""
    full = Path(os.path.normpath(Path.cwd() / path))
    return full.relative_to(root) if full.is_relative_to(root) else None


def uri(path: str) -> tuple[str, bool]:
    """A URI reference of a path, and whether it is relative to the working folder.

    What is not below the working folder has no relative one that means the same elsewhere.
    """
    inside = within(path, Path.cwd())
    if inside is not None:
        return quote(os.fsencode(inside.as_posix())), True
    full = os.path.normpath(Path.cwd() / path)
    return "file://" + quote(os.fsencode(Path(full).as_posix())), False
