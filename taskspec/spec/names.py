"""The names that a file gives: whether they can be given, and which of them nothing uses."""

from __future__ import annotations

import re
from collections.abc import Iterator

from taskspec import signals
from taskspec.expression.functions import FUNCTIONS, REDUCERS
from taskspec.expression.scope import CONSTANTS
from taskspec.spec.fields import MECHANISMS, OWN_FRAMES
from taskspec.spec.model import mapping
from taskspec.spec.objects import kind_of_object
from taskspec.spec.parse_context import ParseContext
from taskspec.spec.words import ENDS
from taskspec.spec.world import is_free
from taskspec.text import nodes
from taskspec.text.codes import register
from taskspec.text.data import Map
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.source import Span
from taskspec.text.units import UNITS

register(
    {
        "TS125": "a name that cannot be given",
        "TS126": "a name given twice",
        "TS130": "a name that nothing uses",
    }
)

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}\Z")
_SHARED = ("world", "frames", "stages")
"""Sections whose names live in one space."""
_ARTICLES = {"world": "an object", "frames": "a frame", "stages": "a stage", "params": "a param"}
_WORDS = {"and", "or", "not", "for", "within", "in"}
_FRAMES = {"world", "tool"}
_OTHER = {"robot", "params"}
_ANY_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
#: Texts for people, in which a word is no use of a name.
_PROSE = ("name", "about")
#: Section -> what one of its entries is, and how it would be used.
_DECLARED = {
    "params": ("param", "use it by its bare name where a number stands, or leave it out"),
    "frames": ("frame", "name it as 'frame' of the task or of a stage, or leave it out"),
}


def collect_names(context: ParseContext) -> None:
    """Enters the names of stages, objects and frames into `context`, and reports bad ones."""
    sections = {key: _names(context.data, key) for key in _SHARED}
    context.stages = dict.fromkeys(sections["stages"])
    context.targets = dict.fromkeys((*context.stages, *ENDS))
    world = mapping(context.data.get("world"))
    context.objects = {name: kind_of_object(world.get(name)) for name in sections["world"]}
    handles = [f"{name}.handle" for name in context.of_kind(*MECHANISMS)]
    loose = [name for name, value in world.items() if is_free(mapping(value))]
    context.held, context.loose = dict.fromkeys((*handles, *loose)), dict.fromkeys(loose)
    posed = context.of_kind("shape", "bushing", *MECHANISMS)
    context.frames = dict.fromkeys((*OWN_FRAMES, *sections["frames"], *posed, *handles))
    _check_unique(sections, context)
    for key, names in (*sections.items(), ("params", _names(context.data, "params"))):
        for name, span in names.items():
            reason = why_not(name, key)
            if reason is not None:
                message = f"'{name}' cannot be the name of {_ARTICLES[key]}"
                context.error("TS125", message, span, reason)


def _names(data: Map, section: str) -> dict[str, Span]:
    """All names of a section and their places, whatever they stand for."""
    node = data.node.get(section)
    if not isinstance(node, nodes.Mapping):
        return {}
    return {name: key.span for name, (key, _) in node.entries.items()}


def _check_unique(sections: dict[str, dict[str, Span]], context: ParseContext) -> None:
    first: dict[str, str] = {}
    for key, names in sections.items():
        for name, place in names.items():
            if name in first:
                span = sections[first[name]][name]
                context.diagnostics.error(
                    "TS126",
                    f"'{name}' names both {_ARTICLES[first[name]]} and {_ARTICLES[key]}",
                    place,
                    "objects, frames and stages share one space of names",
                    (("first given here", span),),
                )
            else:
                first[name] = key


def why_not(name: str, section: str) -> str | None:
    """Why a name cannot be given in a section, None if it can."""
    if not _NAME.match(name):
        rule = "a name is a letter followed by letters, digits and '_'"
        near = re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_")
        return f"{rule}: {near}" if _NAME.match(near) and why_not(near, section) is None else rule
    if name in UNITS:
        return f"'{name}' is a unit"
    if name in REDUCERS or (name in FUNCTIONS and FUNCTIONS[name].rule != "two axes"):
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


def unused(root: nodes.Mapping) -> set[tuple[str, str]]:
    """Sections and names of params and frames whose name no value of the file has as a word.

    A word that means something else, as a coordinate that hides a param, counts as a use: what is
    returned is certain.

    Args:
        root: of a file.
    """
    words = set(_words_of(root))
    return {
        (section, name)
        for section in _DECLARED
        if isinstance(declared := root.get(section), nodes.Mapping)
        for name, (key, _) in declared.entries.items()
        if name not in words and not key.span.source
    }


def warn_unused(root: nodes.Mapping, names: set[tuple[str, str]], diagnostics: Diagnostics) -> None:
    """Reports names that nothing uses.

    Args:
        root: of a file without errors.
        names: sections and names.
        diagnostics: where they are reported.
    """
    for section, name in sorted(names):
        noun, hint = _DECLARED[section]
        span = nodes.place(root, (section, name), key=True)
        diagnostics.warning("TS130", f"nothing uses the {noun} '{name}'", span, hint)


def _words_of(root: nodes.Mapping) -> Iterator[str]:
    """The words of all values: keys are names of the language, or declare one."""
    for key, (_, value) in root.entries.items():
        if key not in _PROSE:
            for scalar in nodes.scalars(value):
                yield from _ANY_WORD.findall(scalar.value)
