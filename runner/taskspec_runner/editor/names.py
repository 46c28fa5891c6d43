"""The names that a text gives and uses: what each is, where it is declared, where it stands."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from taskspec import signals
from taskspec.deferred_methods import dataclass
from taskspec.spec.model import mapping
from taskspec.spec.names import collect_names
from taskspec.spec.parse_context import ParseContext
from taskspec.text import nodes
from taskspec.text.data import to_data
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.source import Source, Span

#: Sections whose keys are names, and what an entry is.
DECLARING = {
    "stages": "stage",
    "world": "object",
    "frames": "frame",
    "params": "param",
    "templates": "template",
}
#: Texts for people, in which a word is no name.
_PROSE = ("name", "about")
_WORD = re.compile(r"(?<![\w.])[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Declared:
    """A name that a file gives.

    Attributes:
        name: the name.
        kind: stage, object, frame, param or template.
        span: of the key that gives it; its `source` is another file's where that gives it.
        value: what stands behind it.
    """

    name: str
    kind: str
    span: Span
    value: nodes.Node


class TaskNames:
    """The names of a task that could be read, as far as it could.

    Attributes:
        declared: what the file and what it includes give, by name.
        stages, objects, frames, targets, held: names, as `ParseContext` has them.
    """

    def __init__(self, root: nodes.Mapping, own: nodes.Mapping) -> None:
        """Of the tree of a task, with what it includes, and of that of its text alone."""
        self._own = own
        #: Files that it includes, in which what they give has its place.
        self.files = {each.span.source for each in nodes.scalars(root)} - {""}
        self.declared: dict[str, Declared] = {}
        for section, kind in DECLARING.items():
            below = root.get(section)
            if isinstance(below, nodes.Mapping):
                for name, (key, value) in below.entries.items():
                    self.declared.setdefault(name, Declared(name, kind, key.span, value))
        found = Diagnostics("")
        context = ParseContext(found, mapping(to_data(root, found)))
        collect_names(context)
        self.stages, self.frames = tuple(context.stages), tuple(context.frames)
        self.targets, self.held = tuple(context.targets), tuple(context.held)
        self.objects: Mapping[str, str] = dict(context.objects)

    def of_kind(self, kind: str) -> tuple[str, ...]:
        """The names of params, templates and so on."""
        return tuple(each.name for each in self.declared.values() if each.kind == kind)

    def signals(self) -> Iterator[tuple[str, str]]:
        """The signals that an expression may use, each with what it is."""
        for name, vector in signals.VECTORS.items():
            yield name, vector.meanings[vector.bare[0]]
            for axis in vector.axes:
                yield f"{name}.{axis}", vector.meanings[axis]
        for table in (signals.SCALARS, signals.CLOCKS):
            for name, single in table.items():
                yield name, next(iter(single.meanings.values()))
        for owner, kind in self.objects.items():
            for name, each in signals.OBJECT.get(kind, {}).items():
                yield f"{owner}.{name}", each.meanings[kind]
        for stage in self.stages:
            yield f"{stage}.visits", "how often the stage has been entered"

    def uses(self, name: str, source: Source) -> list[Span]:
        """The places of a name in the text that these are the names of."""
        return uses_in(self._own, name, source)


def uses_in(own: nodes.Mapping, name: str, source: Source) -> list[Span]:
    """The places of a name in a text: where it is given, as a key and in values.

    Args:
        own: the tree of the text alone.
        name: the name.
        source: the text.
    """
    found = {key.span for key in _name_keys(own) if key.value == name}
    for section, (_, value) in own.entries.items():
        if section not in _PROSE:
            for scalar in nodes.scalars(value):
                found.update(_words_of(scalar, name, source))
    return sorted(found)


def _name_keys(root: nodes.Mapping) -> Iterator[nodes.Scalar]:
    """Keys that are names: those that declare one, and set points of constraints."""
    declaring = [root.get(section) for section in DECLARING]
    naming = [below.get("constraints") for below in _mappings(root)]
    for below in (*declaring, *naming):
        if isinstance(below, nodes.Mapping):
            yield from (key for key, _ in below.entries.values())


def _mappings(node: nodes.Node) -> Iterator[nodes.Mapping]:
    if isinstance(node, nodes.Mapping):
        yield node
        for _, value in node.entries.values():
            yield from _mappings(value)
    elif isinstance(node, nodes.Sequence):
        for item in node.items:
            yield from _mappings(item)


def _words_of(scalar: nodes.Scalar, name: str, source: Source) -> Iterator[Span]:
    """The places of a name in a scalar of the text itself."""
    if scalar.span.source or not nodes.has_word(scalar, name.partition(".")[0]):
        return
    start = source.offset(scalar.span.line, scalar.span.column)
    end = source.offset(scalar.span.end_line, scalar.span.end_column)
    written = source.text[start:end]
    for match in _WORD.finditer(written):
        if match[0] == name:
            yield source.span(start + match.start(), start + match.end())
