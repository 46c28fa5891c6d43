"""The names that a file gives."""

from __future__ import annotations

import re

from taskspec.spec.model import mapping
from taskspec.spec.reading import Reading
from taskspec.text.data import Map
from taskspec.text.expression import signals
from taskspec.text.expression.functions import FUNCTIONS, REDUCERS
from taskspec.text.units import UNITS

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}\Z")
_SHARED = ("world", "frames", "stages")
"""Sections whose names live in one space."""
_ARTICLES = {"world": "an object", "frames": "a frame", "stages": "a stage", "params": "a param"}
_SIGNALS = {*signals.VECTORS, *signals.SCALARS, *signals.CONDITIONS, *signals.CLOCKS, "joint"}
_WORDS = {"and", "or", "not", "for", "within", "in"}
_PLACES = {"end", "fail"}
_FRAMES = {"world", "tool"}
_OTHER = {"robot", "params"}


def collect_names(reading: Reading) -> None:
    """Enter the names of stages, objects and frames into `reading`, and report bad ones."""
    sections = {key: mapping(reading.data.get(key)) for key in _SHARED}
    reading.stages = tuple(sections["stages"])
    reading.objects = tuple(sections["world"])
    handles = [
        f"{name}.handle"
        for name, value in sections["world"].items()
        if "mechanism" in mapping(value)
    ]
    reading.frames = ("world", "tool", *sections["frames"], *reading.objects, *handles)
    _check_unique(sections, reading)
    for key in (*_SHARED, "params"):
        names = mapping(reading.data.get(key))
        for name in names:
            reason = _why_not(name, key)
            if reason is not None:
                message = f"'{name}' cannot be the name of {_ARTICLES[key]}"
                reading.error("TS125", message, names.node.key_span(name), reason)


def _check_unique(sections: dict[str, Map], reading: Reading) -> None:
    first: dict[str, str] = {}
    for key, names in sections.items():
        for name in names:
            if name in first:
                span = sections[first[name]].node.key_span(name)
                reading.diagnostics.error(
                    "TS126",
                    f"'{name}' names both {_ARTICLES[first[name]]} and {_ARTICLES[key]}",
                    names.node.key_span(name),
                    "objects, frames and stages share one space of names",
                    (("first given here", span),),
                )
            else:
                first[name] = key


def _why_not(name: str, section: str) -> str | None:
    """Return why a name cannot be given, None if it can."""
    if not _NAME.match(name):
        return "a name is a letter followed by letters, digits and '_'"
    if name in UNITS:
        return f"'{name}' is a unit"
    if name in FUNCTIONS or name in REDUCERS:
        return f"'{name}' is a function"
    if name in _WORDS:
        return f"'{name}' is a word of expressions"
    if name in signals.CONSTANTS:
        return f"'{name}' is a constant"
    if name in _SIGNALS:
        return f"'{name}' is a signal"
    if name in _PLACES:
        return f"'{name}' is where a run may end"
    if section != "params" and name in _FRAMES | _OTHER:
        return f"'{name}' has a meaning of its own"
    return None
