"""Strict YAML: one document of plain mappings, lists and scalars, with the place of everything.

The pure-Python reader of PyYAML turns text into events; the C one can crash on deep nesting.
Anchors, aliases, merge keys, tags, duplicate keys and further documents are errors, each reported
where it stands, and reading goes on as far as the text allows.
"""

from __future__ import annotations

from collections.abc import Iterator

import yaml

from taskspec.text import traps, unreadable
from taskspec.text.characters import first_forbidden, readable
from taskspec.text.codes import register
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Mapping, Node, Scalar, Sequence
from taskspec.text.origin import origin_of
from taskspec.text.source import Source, Span

register(
    {
        "TS004": "a key is given twice",
        "TS005": "an anchor or an alias",
        "TS006": "a merge key",
        "TS007": "a tag",
        "TS008": "more than one document",
        "TS009": "the file is too large or too deeply nested",
        "TS014": "a key that is not a word",
    }
)

MAX_BYTES = 256 * 1024
MAX_EVENTS = 20_000
MAX_DEPTH = 32
MAX_SCALAR = 8 * 1024


class _StopError(Exception):
    """Reading cannot go on; the reason is reported."""


def read(source: Source, diagnostics: Diagnostics, *, inner: bool = False) -> Node | None:
    """The tree of a text, or None if it cannot be read; everything wrong is reported.

    Args:
        source: the text, with plain line ends.
        diagnostics: where findings go.
        inner: the text is one value rather than a file, so it need not be a mapping.
    """
    if len(source.text.encode("utf-8", "surrogatepass")) > MAX_BYTES:
        diagnostics.error("TS009", f"a task file may have {MAX_BYTES // 1024} KiB", None)
        return None
    text = readable(source.text, diagnostics)
    if text is None:
        return None
    shown = Source(source.name, text)
    try:
        root = _Composer(shown, diagnostics).document()
    except _StopError:
        return None
    except yaml.MarkedYAMLError as error:
        unreadable.explain_syntax(error, shown, diagnostics)
        return None
    except (yaml.YAMLError, ValueError, LookupError, AttributeError, RecursionError) as error:
        # PyYAML lets raw Python errors through for some escapes and directives.
        unreadable.explain_crash(error, shown, diagnostics)
        return None
    if inner:
        return root
    if not isinstance(root, Mapping):
        unreadable.explain_root(root, diagnostics)
        return None
    return root


class _Composer:
    """Builds nodes from events."""

    def __init__(self, source: Source, diagnostics: Diagnostics) -> None:
        self.source = source
        self.diagnostics = diagnostics
        self._events: Iterator[yaml.Event] = iter(yaml.parse(source.text, Loader=yaml.SafeLoader))
        self._count = 0

    def document(self) -> Node | None:
        """The root of the one document, None if there is none."""
        root: Node | None = None
        documents = 0
        while True:
            event = self._next()
            if isinstance(event, yaml.StreamEndEvent):
                return root
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    self.diagnostics.error(
                        "TS008", "a second document", self._span(event), "one task per file"
                    )
                    return root
            elif not isinstance(event, yaml.StreamStartEvent | yaml.DocumentEndEvent):
                root = self._node(event, 1)

    def _next(self) -> yaml.Event:
        event = next(self._events)
        self._count += 1
        if self._count > MAX_EVENTS:
            self.diagnostics.error(
                "TS009", f"more than {MAX_EVENTS} parts in one file", self._span(event)
            )
            raise _StopError
        return event

    def _node(self, event: yaml.Event, depth: int) -> Node | None:
        if isinstance(event, yaml.AliasEvent):
            self.diagnostics.error(
                "TS005",
                f"an alias ('*{event.anchor}')",
                self._span(event),
                "write the value out, or give it a name under 'params'; "
                "a text that begins with '*' needs quotes",
            )
            return None
        assert isinstance(event, yaml.ScalarEvent | yaml.CollectionStartEvent)
        self._properties(event)
        if isinstance(event, yaml.ScalarEvent):
            if event.tag is not None and not event.value:
                return None
            return self._scalar(event)
        if depth > MAX_DEPTH:
            self.diagnostics.error("TS009", f"nested deeper than {MAX_DEPTH}", self._span(event))
            raise _StopError
        if isinstance(event, yaml.SequenceStartEvent):
            return self._sequence(event, depth)
        return self._mapping(event, depth)

    def _properties(self, event: yaml.ScalarEvent | yaml.CollectionStartEvent) -> None:
        if event.anchor is not None:
            self.diagnostics.error(
                "TS005",
                f"an anchor ('&{event.anchor}')",
                self._span(event),
                "give shared values a name under 'params'; a text that begins with '&' "
                "needs quotes",
            )
        if event.tag is not None:
            self.diagnostics.error(
                "TS007",
                "a tag",
                self._span(event),
                "leave it out; a text that begins with '!' needs quotes, and the opposite of a "
                "condition is 'not'",
            )

    def _sequence(self, start: yaml.CollectionStartEvent, depth: int) -> Sequence:
        sequence = Sequence(self._span(start), bool(start.flow_style))
        while not isinstance(event := self._next(), yaml.SequenceEndEvent):
            node = self._node(event, depth + 1)
            if node is None:
                sequence.broken = True
            else:
                sequence.items.append(node)
        if sequence.flow:
            traps.join_items(sequence, self.source, self.diagnostics)
        return sequence

    def _mapping(self, start: yaml.CollectionStartEvent, depth: int) -> Mapping:
        mapping = Mapping(self._span(start), bool(start.flow_style))
        pairs: list[tuple[Scalar, Node]] = []
        while not isinstance(event := self._next(), yaml.MappingEndEvent):
            key = self._node(event, depth + 1)
            value = self._node(self._next(), depth + 1)
            if key is None or value is None:
                mapping.broken = True
            elif not isinstance(key, Scalar) or key.empty:
                self.diagnostics.error(
                    "TS014",
                    "a key is one word before a colon",
                    self._span(event),
                    "" if isinstance(key, Scalar) else "put braces in a text in quotes",
                )
                mapping.broken = True
            else:
                pairs.append((key, value))
        for key, value in traps.repair_pairs(pairs, mapping, self.source, self.diagnostics):
            self._enter(mapping, key, value)
        return mapping

    def _enter(self, mapping: Mapping, key: Scalar, value: Node) -> None:
        if key.value == "<<" and key.plain:
            self.diagnostics.error("TS006", "a merge key", key.span, "write the keys out")
            mapping.broken = True
        elif key.value in mapping.entries:
            self.diagnostics.error(
                "TS004",
                f"the key '{key.value}' is given twice",
                key.span,
                "keep one of the two",
                (("first given here", mapping.key_span(key.value)),),
            )
        else:
            mapping.entries[key.value] = (key, value)

    def _scalar(self, event: yaml.ScalarEvent) -> Scalar:
        start, end = _marks(event)[0].index, _marks(event)[1].index
        span = self._span(event)
        value: str = event.value
        if len(value) > MAX_SCALAR:
            self.diagnostics.error("TS009", f"a text longer than {MAX_SCALAR} characters", span)
            raise _StopError
        if (hidden := first_forbidden(value)) is not None:
            message = f"{hidden} may not stand in a task file, not even as an escape"
            self.diagnostics.error("TS002", message, span)
        skip = 0
        if event.style in ("'", '"'):
            skip = 1
        elif event.style in ("|", ">"):
            skip = self.source.text[start:end].find("\n") + 1
        origin = origin_of(self.source, span, value, start, end, skip)
        return Scalar(value, event.style is None, origin, traps.comment_after(self.source, end))

    def _span(self, event: yaml.Event) -> Span:
        start, end = _marks(event)
        # What is implied has no extent of its own; a place always has one.
        width = 1 if start.index == end.index else 0
        return Span(start.line + 1, start.column + 1, end.line + 1, end.column + 1 + width)


def _marks(event: yaml.Event) -> tuple[yaml.Mark, yaml.Mark]:
    start, end = event.start_mark, event.end_mark
    assert isinstance(start, yaml.Mark)
    assert isinstance(end, yaml.Mark)
    return start, end
