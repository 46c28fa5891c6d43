"""The tree of a YAML text: mappings, lists and scalars, each with its place."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import field

from taskspec.deferred_methods import dataclass
from taskspec.text.origin import Origin
from taskspec.text.source import Span


@dataclass(slots=True)
class Scalar:
    """A scalar; `plain` means written without quotes or block header.

    `comment` is what follows in its line if that looks like text rather than like a comment.
    """

    value: str
    plain: bool
    origin: Origin
    comment: str = ""

    @property
    def span(self) -> Span:
        """The place of the scalar, quotes included."""
        return self.origin.span

    @property
    def empty(self) -> bool:
        """Whether nothing is written here."""
        return self.plain and not self.value


@dataclass(slots=True)
class Sequence:
    """A list; `broken` means that an entry was left out because it is wrong."""

    span: Span
    flow: bool
    items: list[Node] = field(default_factory=list)
    broken: bool = False


@dataclass(slots=True)
class Mapping:
    """A mapping.

    Attributes:
        span: its place.
        flow: whether it is written in braces.
        entries: key and value, by the key's name.
        broken: an entry was left out because it is wrong.
        written: the key that the file has in place of one of the language, as `diameter` for
            `radius`, once it is read.
    """

    span: Span
    flow: bool
    entries: dict[str, tuple[Scalar, Node]] = field(default_factory=dict)
    broken: bool = False
    written: dict[str, str] = field(default_factory=dict)

    def get(self, key: str) -> Node | None:
        """The value of a key."""
        entry = self.entries.get(self.as_written(key))
        return entry[1] if entry else None

    def key_span(self, key: str) -> Span:
        """The place of a key, or of the mapping if it has no such key."""
        entry = self.entries.get(self.as_written(key))
        return entry[0].span if entry else self.span

    def as_written(self, key: str) -> str:
        """A key as the file has it."""
        return self.written.get(key, key)


Node = Scalar | Sequence | Mapping
Step = str | int


def find(root: Node, path: tuple[Step, ...]) -> tuple[Node, int]:
    """The node at `path`, or its nearest existing ancestor, and how many steps fitted."""
    node = root
    for index, step in enumerate(path):
        below = child(node, step)
        if below is None:
            return node, index
        node = below
    return node, len(path)


def child(node: Node, step: Step) -> Node | None:
    """The node one step below."""
    if isinstance(node, Mapping):
        return node.get(str(step))
    if isinstance(node, Sequence) and isinstance(step, int) and 0 <= step < len(node.items):
        return node.items[step]
    return None


def place(root: Node, path: tuple[Step, ...], *, key: bool = False) -> Span:
    """The place to point at for `path`; the nearest ancestor if it does not exist.

    A scalar is its own place, a flow collection its bracket, a block collection the key it hangs
    on. With `key`, the last key itself.
    """
    node, depth = find(root, path)
    found = path[:depth]
    parent = find(root, found[:-1])[0] if found else None
    hangs = isinstance(parent, Mapping) and isinstance(found[-1], str)
    if hangs and (key or not (isinstance(node, Scalar) or node.flow)):
        assert isinstance(parent, Mapping)
        return parent.key_span(str(found[-1]))
    return pointer(node)


def pointer(node: Node) -> Span:
    """The place of a scalar, or the first character of a collection or of nothing."""
    span = node.span
    if isinstance(node, Scalar) and node.value:
        return span
    return span.covering(span.line, span.column, span.line, span.column + 1)


def is_empty(node: Node) -> bool:
    """Whether nothing is written at a place."""
    return isinstance(node, Scalar) and node.empty


def has_word(node: Scalar, word: str) -> bool:
    """Whether a scalar has a word that is not a part of a path or of another word."""
    return re.search(rf"(?<![\w.]){re.escape(word)}(?!\w)", node.value) is not None


def scalars(node: Node) -> Iterator[Scalar]:
    """Every scalar below a node, keys left out."""
    if isinstance(node, Scalar):
        yield node
    elif isinstance(node, Sequence):
        for item in node.items:
            yield from scalars(item)
    else:
        for _, value in node.entries.values():
            yield from scalars(value)


def in_one_line(node: Node) -> str:
    """A node as YAML in one line, with braces and brackets."""
    if isinstance(node, Mapping):
        parts = (f"{key}: {in_one_line(value)}" for key, (_, value) in node.entries.items())
        return f"{{{', '.join(parts)}}}"
    if isinstance(node, Sequence):
        return f"[{', '.join(map(in_one_line, node.items))}]"
    value = " ".join(node.value.split())
    if node.plain and not any(c in value for c in ",[]{}"):
        return value
    return "'" + value.replace("'", "''") + "'"
