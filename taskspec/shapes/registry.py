"""All kinds of shape, by their words in a file."""

from __future__ import annotations

from inspect import get_annotations
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
        TypeError: it does not state all that a shape of its kind does.
        ValueError: there is a kind of that name, or one of its keys means something else already.
    """
    if _read:
        raise RuntimeError(f"register {kind.__name__} before {_read[0]!r} is imported")
    missing = [*_unstated(kind), *sorted(kind.__abstractmethods__)]
    if missing:
        raise TypeError(f"the shape {kind.__name__} does not state its {', '.join(missing)}")
    if kind.name in SHAPES:
        raise ValueError(f"there is a shape {kind.name!r} already")
    for key in kind.keys:
        if size_keys().get(key.name, key) != key:
            raise ValueError(f"{key.name!r} of {kind.name!r} differs from that of other shapes")
    SHAPES[kind.name] = kind
    return kind


def _unstated(kind: type[Surface]) -> list[str]:
    """Facts of a class that neither it nor what it is derived from gives."""
    facts = {n: a for base in kind.__mro__ for n, a in get_annotations(base).items()}
    return [n for n, a in facts.items() if "ClassVar" in str(a) and not hasattr(kind, n)]


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
