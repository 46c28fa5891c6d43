"""All modes of axes that a file can give, by their own keys."""

from __future__ import annotations

from collections.abc import Iterator
from inspect import isabstract
from typing import TypeVar

from taskspec.modes.force import Force
from taskspec.modes.key import ModeKey
from taskspec.modes.mode import AxisMode

MODES: dict[str, type[AxisMode]] = {}
"""Modes by their own key, in the order in which they are shown."""

_M = TypeVar("_M", bound=type[AxisMode])
_read: list[str] = []


def register(mode: _M) -> _M:
    """Makes a mode part of the language; a class decorator.

    Raises:
        RuntimeError: the language has been imported, and its models are made.
        TypeError: it lacks its key, its reference, its hand-over or its words.
        ValueError: one of its keys means something else already.
    """
    if isabstract(mode) or not mode.keys:
        raise TypeError(f"the mode {mode.__name__} does not state all that a mode has")
    own = mode.keys[0].name
    if _read:
        raise RuntimeError(f"register {own!r} before {_read[0]!r} is imported")
    if own in MODES:
        raise ValueError(f"there is a mode {own!r} already")
    known = {key.name: key for key in axis_keys()}
    for key in mode.keys:
        if known.get(key.name, key) != key:
            raise ValueError(f"{key.name!r} of {own!r} differs from that of other modes")
    MODES[own] = mode
    return mode


def all_modes(reader: str) -> dict[str, type[AxisMode]]:
    """All modes, for a module whose models are made of them: no more can be added."""
    _read.append(reader)
    return MODES


def axis_keys() -> Iterator[ModeKey]:
    """All keys of modes and of forces, each once."""
    keys = [key for mode in MODES.values() for key in mode.keys]
    yield from dict.fromkeys([*keys, *Force.keys])


def force_keys() -> tuple[str, ...]:
    """The keys of which one gives a force set point."""
    return tuple(key.name for key in Force.keys if not key.companion)


def companions() -> Iterator[tuple[ModeKey, tuple[str, ...]]]:
    """Keys that have no meaning alone, and the keys beside which each has one."""
    for key in axis_keys():
        if key.companion:
            owners = [own for own, mode in MODES.items() if key in mode.keys]
            yield key, (*owners, *(force_keys() if key in Force.keys else ()))


def mode_given(entry: object, *, rotation: bool) -> AxisMode | None:
    """The mode that an axis of a file gives; None where it gives none.

    Args:
        entry: the axis, with the keys of the modes as attributes.
        rotation: whether it is one.
    """
    for own, mode in MODES.items():
        if getattr(entry, own, None) is not None:
            values = {key.name: getattr(entry, key.name) for key in mode.keys}
            return mode.of_keys(values, rotation=rotation)
    return None


def force_given(entry: object) -> Force | None:
    """The force set point of an axis of a file; None where it gives none."""
    wanted = (getattr(entry, name, None) for name in force_keys())
    given = next((expression for expression in wanted if expression is not None), None)
    return None if given is None else Force(given, getattr(entry, "ramp", None))
