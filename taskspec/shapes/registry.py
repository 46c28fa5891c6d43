"""All kinds of shape, by their words in a file."""

from __future__ import annotations

from typing import TypeVar

from taskspec.shapes.surface import SizeKey, Surface, ToolSurface

SHAPES: dict[str, type[Surface]] = {}
"""Kinds of shape by name, in the order in which they are shown."""

_Kind = TypeVar("_Kind", bound=type[Surface])
_read: list[str] = []


def register(kind: _Kind) -> _Kind:
    """Makes a kind of shape part of the language; a class decorator.

    Raises:
        RuntimeError: the language has been imported, and its models are made.
        ValueError: there is a kind of that name, or one of its keys means something else already.
    """
    if _read:
        raise RuntimeError(f"register {kind.name!r} before {_read[0]!r} is imported")
    if kind.name in SHAPES:
        raise ValueError(f"there is a shape {kind.name!r} already")
    for key in kind.keys:
        if size_keys().get(key.name, key) != key:
            raise ValueError(f"{key.name!r} of {kind.name!r} differs from that of other shapes")
    SHAPES[kind.name] = kind
    return kind


def all_shapes(reader: str) -> dict[str, type[Surface]]:
    """All kinds of shape, for a module whose models are made of them: no more can be added."""
    _read.append(reader)
    return SHAPES


def size_keys() -> dict[str, SizeKey]:
    """All sizes of shapes in a file, by key."""
    return {key.name: key for kind in SHAPES.values() for key in kind.keys}


def with_size(name: str) -> list[str]:
    """Names of the shapes that have a size."""
    return [kind.name for kind in SHAPES.values() if any(key.name == name for key in kind.keys)]


def tool_shapes() -> dict[str, type[ToolSurface]]:
    """The shapes that a tool can end in, the usual one first."""
    kinds = reversed(SHAPES.values())
    return {kind.name: kind for kind in kinds if issubclass(kind, ToolSurface)}
