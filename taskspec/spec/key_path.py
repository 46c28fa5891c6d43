"""Paths of keys into a task file, which only keys that the language has can make.

`FILE.stages["press"].axes["z"].force` is the path of a value. A key that no model has raises at
once, whatever is in a file. A key that is right and that a file leaves out is no mistake: the
place of its path is then that of the nearest ancestor which the file has.
"""

from __future__ import annotations

import types
from collections.abc import Iterator
from functools import cache, lru_cache
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel

from taskspec.geometry.axis import AXES, PAIRS
from taskspec.spec.fault import Fault
from taskspec.spec.gains import AxisValues
from taskspec.spec.task import Task
from taskspec.spec.truth import FAULTS, DeclaredTruth

Step = str | int

#: What the file may give as keys of a gain.
_OF_A_GAIN = frozenset({*AXES, *PAIRS, "linear", "angular"})


class UnknownKeyError(LookupError, AttributeError):
    """A path with a key that the language does not have."""


class KeyPath:
    """A path of keys and list indices from the root of a task file.

    A key of the language is an attribute, or an item where it is in a variable; names that a file
    invents and list indices are items: `FILE.world[name].stiffness`, `FILE.vary[path][0]`.
    """

    __slots__ = ("_key", "_steps", "_types")

    def __init__(
        self, steps: tuple[Step, ...] = (), below: tuple[Any, ...] = (Task,), *, key: bool = False
    ) -> None:
        """Makes a path; use `FILE` and its keys instead.

        Args:
            steps: keys and indices from the root.
            below: what may stand there: models, mappings, lists and values.
            key: it is the path of the last key rather than of its value.
        """
        self._steps = steps
        self._types = below
        self._key = key

    def __getattr__(self, name: str) -> KeyPath:
        """The path of a key of the language below this one.

        Raises:
            UnknownKeyError: nothing that may stand here has such a key.
        """
        if name.startswith("_"):
            raise AttributeError(name)
        return self[name]

    def __getitem__(self, step: Step) -> KeyPath:
        """The path of a name, a list index or a key below this one.

        Raises:
            UnknownKeyError: nothing that may stand here has such a key.
        """
        below = _below(self._types, step)
        if not below:
            known = sorted({key for kind in self._types for key in _keys(kind)})
            has = f"its keys: {', '.join(known)}" if known else "it has no keys"
            raise UnknownKeyError(f"{self} has no {step!r}; {has}")
        return KeyPath((*self._steps, step), below)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, KeyPath):
            return NotImplemented
        return (self._steps, self._key) == (other._steps, other._key)

    def __hash__(self) -> int:
        return hash((self._steps, self._key))

    def __str__(self) -> str:
        return ".".join(map(str, self._steps)) or "the file"

    def __repr__(self) -> str:
        return f"KeyPath({self._steps!r}{', key=True' if self._key else ''})"


FILE = KeyPath()
"""The root of every task file."""


def key_of(path: KeyPath) -> KeyPath:
    """The path of the last key itself rather than of its value."""
    return KeyPath(path._steps, path._types, key=True)


def steps_of(path: KeyPath) -> tuple[Step, ...]:
    """Keys and list indices of a path, from the root."""
    return path._steps


def is_key(path: KeyPath) -> bool:
    """Whether a path is that of a key rather than of its value."""
    return path._key


def below(path: KeyPath, *steps: Step) -> KeyPath:
    """The path that some steps lead to from another.

    Raises:
        UnknownKeyError: they do not exist in the language.
    """
    for step in steps:
        path = path[step]
    return path


@lru_cache(maxsize=1024)  # names that files invent are among the steps
def _below(kinds: tuple[Any, ...], step: Step) -> tuple[Any, ...]:
    """What may stand one step below what may stand somewhere."""
    return tuple(child for kind in kinds for child in _child(kind, step))


def _child(kind: Any, step: Step) -> tuple[Any, ...]:
    """What may stand one step below a kind of thing; nothing where there is no such step."""
    if get_origin(kind) is dict:
        return _kinds(get_args(kind)[1]) if isinstance(step, str) else ()
    if get_origin(kind) is tuple:
        entries = [e for e in get_args(kind) if e is not Ellipsis]
        return tuple(k for e in entries for k in _kinds(e)) if isinstance(step, int) else ()
    if kind is AxisValues:
        return (float,) if step in _OF_A_GAIN else ()
    if kind is DeclaredTruth:
        return (tuple[Fault, ...],) if step == FAULTS else (str,) if isinstance(step, str) else ()
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return _fields(kind).get(str(step), ())
    return ()


def _keys(kind: Any) -> Iterator[str]:
    """The keys of the language that a kind of thing has."""
    if kind is AxisValues:
        yield from _OF_A_GAIN
    elif isinstance(kind, type) and issubclass(kind, BaseModel):
        yield from _fields(kind)


@cache
def _fields(model: type[BaseModel]) -> dict[str, tuple[Any, ...]]:
    """The keys of a model and of those that are made from it, with what may stand at each."""
    found: dict[str, tuple[Any, ...]] = {}
    waiting = [model]
    while waiting:
        each = waiting.pop()
        waiting += each.__subclasses__()
        for name, field in each.model_fields.items():
            found[name] = (*found.get(name, ()), *_kinds(field.annotation))
    return {name: tuple(dict.fromkeys(kinds)) for name, kinds in found.items()}


def _kinds(annotation: Any) -> tuple[Any, ...]:
    """What an annotation allows, one by one, without `None` and without metadata."""
    if get_origin(annotation) is Annotated:
        return _kinds(get_args(annotation)[0])
    if get_origin(annotation) in (Union, types.UnionType):
        return tuple(k for each in get_args(annotation) for k in _kinds(each))
    return () if annotation is type(None) else (annotation,)
