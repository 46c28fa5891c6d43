"""The names that a file gives."""

from __future__ import annotations

import re

from taskspec import signals
from taskspec.spec.fields import MECHANISMS
from taskspec.spec.model import mapping
from taskspec.spec.objects import kind_of_object
from taskspec.spec.reading import Reading
from taskspec.spec.words import ENDS
from taskspec.spec.world import is_free
from taskspec.text.codes import register
from taskspec.text.data import Map
from taskspec.text.expression.functions import FUNCTIONS, REDUCERS
from taskspec.text.expression.scope import CONSTANTS
from taskspec.text.nodes import Mapping
from taskspec.text.source import Span
from taskspec.text.units import UNITS

register(
    {
        "TS125": "a name that cannot be given",
        "TS126": "a name given twice",
    }
)

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}\Z")
_SHARED = ("world", "frames", "stages")
"""Sections whose names live in one space."""
_ARTICLES = {"world": "an object", "frames": "a frame", "stages": "a stage", "params": "a param"}
_WORDS = {"and", "or", "not", "for", "within", "in"}
_FRAMES = {"world", "tool"}
_OTHER = {"robot", "params"}


def collect_names(reading: Reading) -> None:
    """Enter the names of stages, objects and frames into `reading`, and report bad ones."""
    sections = {key: _names(reading.data, key) for key in _SHARED}
    reading.stages = dict.fromkeys(sections["stages"])
    reading.targets = dict.fromkeys((*reading.stages, *ENDS))
    world = mapping(reading.data.get("world"))
    reading.objects = {name: kind_of_object(world.get(name)) for name in sections["world"]}
    handles = [f"{name}.handle" for name in reading.of_kind(*MECHANISMS)]
    loose = [name for name, value in world.items() if is_free(mapping(value))]
    reading.held = dict.fromkeys((*handles, *loose))
    own = ("world", "tool")
    posed = reading.of_kind("shape", *MECHANISMS)
    reading.frames = dict.fromkeys((*own, *sections["frames"], *posed, *handles))
    _check_unique(sections, reading)
    for key, names in (*sections.items(), ("params", _names(reading.data, "params"))):
        for name, span in names.items():
            reason = _why_not(name, key)
            if reason is not None:
                message = f"'{name}' cannot be the name of {_ARTICLES[key]}"
                reading.error("TS125", message, span, reason)


def _names(data: Map, section: str) -> dict[str, Span]:
    """Return all names of a section and their places, whatever they stand for."""
    node = data.node.get(section)
    if not isinstance(node, Mapping):
        return {}
    return {name: key.span for name, (key, _) in node.entries.items()}


def _check_unique(sections: dict[str, dict[str, Span]], reading: Reading) -> None:
    first: dict[str, str] = {}
    for key, names in sections.items():
        for name, place in names.items():
            if name in first:
                span = sections[first[name]][name]
                reading.diagnostics.error(
                    "TS126",
                    f"'{name}' names both {_ARTICLES[first[name]]} and {_ARTICLES[key]}",
                    place,
                    "objects, frames and stages share one space of names",
                    (("first given here", span),),
                )
            else:
                first[name] = key


def _why_not(name: str, section: str) -> str | None:
    """Return why a name cannot be given, None if it can."""
    if not _NAME.match(name):
        rule = "a name is a letter followed by letters, digits and '_'"
        near = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
        return f"{rule}: {near}" if _NAME.match(near) and _why_not(near, section) is None else rule
    if name in UNITS:
        return f"'{name}' is a unit"
    if name in FUNCTIONS or name in REDUCERS:
        return f"'{name}' is a function"
    if name in _WORDS:
        return f"'{name}' is a word of expressions"
    if name in CONSTANTS:
        return f"'{name}' is a constant"
    if name in (*signals.words(), *signals.CLOCKS, "joint"):
        return f"'{name}' is a signal"
    if name in ENDS:
        return f"'{name}' is where a run may end"
    if section != "params" and name in _FRAMES | _OTHER:
        return f"'{name}' has a meaning of its own"
    return None
