"""All kinds of paths, by their keys."""

from __future__ import annotations

from inspect import isabstract
from typing import TypeVar

from taskspec.motion.paths.form import PathForm

PATHS: dict[str, type[PathForm]] = {}
"""Kinds of paths by their keys, in the order in which they are shown."""

_P = TypeVar("_P", bound=type[PathForm])
_read: list[str] = []


def register(form: _P) -> _P:
    """Makes a kind of path part of the language; a class decorator.

    Raises:
        RuntimeError: the language has been imported, and its models are made.
        TypeError: it lacks its keys, its curve, its axes or its length.
        ValueError: there is one with its key.
    """
    if isabstract(form) or not form.keys:
        raise TypeError(f"the path {form.__name__} does not state all that a path has")
    if _read:
        raise RuntimeError(f"register {form.name!r} before {_read[0]!r} is imported")
    if form.name in PATHS:
        raise ValueError(f"there is a path {form.name!r} already")
    PATHS[form.name] = form
    return form


def all_paths(reader: str) -> dict[str, type[PathForm]]:
    """All kinds, for a module whose models are made of them: no more can be added."""
    _read.append(reader)
    return PATHS
