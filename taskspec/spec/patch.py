"""A task's text with values changed as overrides change them; comments and layout stay."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from taskspec.spec.alias import SAME
from taskspec.spec.overrides import NAMED_BY_FILES, SHORT_FORMS, WITH_ALIASES, steps_of
from taskspec.spec.task import Task
from taskspec.spec.templates import USE, WITH
from taskspec.text import nodes
from taskspec.text.characters import normal
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Mapping as MappingNode
from taskspec.text.nodes import Node, Scalar, Sequence
from taskspec.text.source import Source
from taskspec.text.yaml import read

#: The keys of a task in the order in which new sections are put.
_KEYS = tuple(Task.model_fields)
#: Spaces by which what is written anew is indented.
_INDENT = 2


class PatchError(ValueError):
    """A value that cannot be written into a text: it stands in another file or in a template."""


def patched(text: str, changes: Mapping[str, str]) -> str:
    """A task's text with values changed.

    A value that the text has is replaced where it stands; another one gets a line of its own, or a
    place between braces, behind its neighbours. All else keeps its characters.

    Args:
        text: of a task file that reads.
        changes: dotted path, or the bare name of a param, to YAML text in one line, as overrides
            have them.

    Returns:
        The text, whose tree is that of the file with these overrides.

    Raises:
        PatchError: the text has no such place, or what the value belongs to stands elsewhere.
    """
    ends = "\r\n" if "\r\n" in text else "\n"
    mark = "\ufeff" if text.startswith("\ufeff") else ""
    found = normal(text)
    for path, value in changes.items():
        found = _Patch(found, path, value).text()
    return mark + (found if ends == "\n" else found.replace("\n", ends))


def without(text: str, keys: Collection[str]) -> str:
    """A task's text without some of its sections, each with what stands above the next one.

    Args:
        text: of a task file that reads.
        keys: of sections.

    Raises:
        PatchError: the text does not read.
    """
    found = normal(text)
    root = read(Source("", found), Diagnostics(""))
    if not isinstance(root, MappingNode) or root.flow:
        raise PatchError("the text does not read as a task with a line for each section")
    source = Source("", found)
    starts = [(source.offset(k.span.line, 1), k.value) for k, _ in root.entries.values()]
    ends = [start for start, _ in starts[1:]] + [len(found)]
    parts = [found[: starts[0][0]]]
    parts += [found[a:b] for (a, key), b in zip(starts, ends, strict=True) if key not in keys]
    return "".join(parts)


class _Patch:
    """One change of a text."""

    def __init__(self, text: str, path: str, value: str) -> None:
        self._source, self._path = Source("", text), path
        self._value = " ".join(value.split())
        self._new = read(Source("", self._value), Diagnostics(""), inner=True)
        root = read(self._source, Diagnostics(""))
        if not isinstance(root, MappingNode):
            raise PatchError("the text does not read as a task")
        self._root = root
        self._steps = steps_of(root, path, self._new, _KEYS)

    def text(self) -> str:
        """The text with it."""
        node: Node = self._root
        braces = False
        for depth, step in enumerate(self._steps):
            word = SHORT_FORMS.get(self._steps[depth - 1]) if depth else None
            if isinstance(node, Scalar) and word is not None:
                if step == word:
                    return self._replaced(node, braces=braces)
                start, end = self._extent(node)
                full = f"{{{word}: {self._source.text[start:end]}}}"
                return self._again(self._with(start, end, full))
            below = self._below(node, step)
            braces = braces or (not isinstance(node, Scalar) and node.flow)
            if below is None:
                assert isinstance(node, MappingNode)
                return self._added(node, depth, braces=braces)
            node = below
        return self._replaced(node, braces=braces)

    def _again(self, text: str) -> str:
        """Another text with the same change."""
        return _Patch(text, self._path, self._value).text()

    def _fit(self, *, braces: bool) -> str:
        """The value as it can stand at a place, between braces or behind a key."""
        new, value = self._new, self._value
        if isinstance(new, MappingNode) and not new.flow:
            return f"{{{value}}}"
        if braces and isinstance(new, Scalar) and new.plain and any(c in value for c in ",[]{}"):
            return f'"{value}"'
        return value

    def _below(self, node: Node, step: str) -> Node | None:
        """What a key or a number leads to; None where a mapping lacks it."""
        if isinstance(node, Sequence) and step.isdigit() and int(step) < len(node.items):
            return node.items[int(step)]
        if isinstance(node, MappingNode):
            return node.entries[step][1] if step in node.entries else None
        raise PatchError(f"the text has no place for {self._path!r}: nothing can have {step!r}")

    def _replaced(self, node: Node, *, braces: bool) -> str:
        """The text with the value in the place of a node."""
        value = self._fit(braces=braces)
        start, end = self._extent(node)
        empty = isinstance(node, Scalar) and node.empty
        if isinstance(node, Scalar) or node.flow:
            return self._with(start, end, f" {value}" if empty else value)
        text = self._source.text
        line = text.rfind("\n", 0, start)
        if text[line + 1 : start].strip():
            return self._with(start, end, value)  # It begins behind the dash of a list.
        # The value goes behind the key, whatever comment is there, and the block's lines leave.
        behind = text.index(":", self._extent(self._key())[1]) + 1
        return f"{text[:behind]} {value}{text[behind:line]}{text[end:]}"

    def _key(self) -> Scalar:
        """The last key of the path."""
        steps = tuple(int(step) if step.isdigit() else step for step in self._steps[:-1])
        owner = nodes.find(self._root, steps)[0]
        assert isinstance(owner, MappingNode)
        return owner.entries[self._steps[-1]][0]

    def _added(self, owner: MappingNode, depth: int, *, braces: bool) -> str:
        """The text with a key that a mapping lacks, and what is below it."""
        steps = self._steps
        self._check_place(depth)
        same = SAME.get(steps[-1], set()) if steps[0] in WITH_ALIASES else set()
        if depth == len(steps) - 1 and (other := next((k for k in same if k in owner.entries), "")):
            start, end = self._extent(owner.entries[other][0])
            return self._again(self._with(start, end, steps[-1]))
        block = depth == 0 and len(steps) > 1
        below = steps[depth + 1 + block :]
        inner = self._fit(braces=braces or bool(below))
        for step in reversed(below):
            inner = f"{{{step}: {inner}}}"
        if owner.flow or not owner.entries:
            return self._in_braces(owner, f"{steps[depth]}: {inner}")
        line = f"{steps[depth]}: {inner}"
        if block:
            line = f"{steps[0]}:\n{' ' * _INDENT}{steps[1]}: {inner}"
        return self._on_a_line(owner, line, top=depth == 0)

    def _check_place(self, depth: int) -> None:
        """Finds out whether a key that is not there may be added.

        Raises:
            PatchError: it may not.
        """
        steps = self._steps
        invented = depth <= 1 and steps[0] in NAMED_BY_FILES
        if invented or (depth == 0 and steps[0] not in _KEYS):
            raise PatchError(f"the text itself has no '{steps[depth]}' for {self._path!r}")
        stage = self._below(self._root, steps[0]) if depth == 2 and steps[0] == "stages" else None
        entry = stage.get(steps[1]) if isinstance(stage, MappingNode) else None
        of_template = isinstance(entry, MappingNode) and USE in entry.entries
        if of_template and len(steps) > depth + 1 and steps[2] not in (USE, WITH):
            message = f"{self._path!r} stands in a template: give all of '{steps[2]}' at once"
            raise PatchError(message)

    def _in_braces(self, owner: MappingNode, entry: str) -> str:
        """The text with an entry at the end of a mapping in braces."""
        if not owner.entries:
            start, end = self._extent(owner)
            return self._with(start, end, f"{{{entry}}}")
        end = self._extent([*owner.entries.values()][-1][1])[1]
        return self._with(end, end, f", {entry}")

    def _on_a_line(self, owner: MappingNode, entry: str, *, top: bool) -> str:
        """The text with an entry on a line of its own, in a mapping that has lines."""
        behind = [*owner.entries.values()][-1]
        if top:
            place = _KEYS.index(self._steps[0])
            before = [key for key in owner.entries if key in _KEYS[:place]]
            behind = owner.entries[before[-1]] if before else behind
        first = next(iter(owner.entries.values()))[0]
        text = self._source.text
        end = text.find("\n", self._extent(behind[1])[1] or 0)
        end = len(text) if end < 0 else end
        indent = " " * (first.span.column - 1)
        # Sections that blank lines part are parted from a new one, too.
        apart = "\n" if top and text[end : end + 2] == "\n\n" else ""
        lines = entry.replace("\n", f"\n{indent}")
        return self._with(end, end, f"{apart}\n{indent}{lines}")

    def _extent(self, node: Node) -> tuple[int, int]:
        """First character of a node, and that behind its last one."""
        span = node.span
        start = self._source.offset(span.line, span.column)
        if isinstance(node, Scalar) and node.empty:
            return start, start
        if isinstance(node, Scalar):
            end = self._source.offset(span.end_line, span.end_column)
            return start, len(self._source.text[:end].rstrip())
        last = node.items if isinstance(node, Sequence) else [v for _, v in node.entries.values()]
        end = self._extent(last[-1])[1] if last else start + 1
        return start, self._closed(end) if node.flow else end

    def _closed(self, at: int) -> int:
        """Behind the bracket that closes a collection, of which nothing but a comma is left."""
        text = self._source.text
        while text[at] not in "]}":
            at = text.index("\n", at) if text[at] == "#" else at + 1
        return at + 1

    def _with(self, start: int, end: int, new: str) -> str:
        text = self._source.text
        return text[:start] + new + text[end:]
