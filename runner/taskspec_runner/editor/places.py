"""What a word in a text is: what hovering over it says, where it is given, where it is used."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

from taskspec import signals
from taskspec.deferred_methods import dataclass
from taskspec.expression.functions import FUNCTIONS, REDUCERS
from taskspec.laws import LAWS
from taskspec.text.diagnostic import Diagnostics
from taskspec.text.nodes import Mapping
from taskspec.text.source import Source, Span
from taskspec.text.units import describe, fitting, si_unit
from taskspec.text.yaml import read
from taskspec_runner.editor.cursor import cursor_at
from taskspec_runner.editor.key_schema import key_at
from taskspec_runner.editor.names import DECLARING, Declared, uses_in
from taskspec_runner.editor.opened import OpenedFile

_DOTTED = re.compile(r"[A-Za-z_][A-Za-z0-9_-]*(?:\.[A-Za-z0-9_]+)*")
_PAGES = Path("docs") / "language"
_HEADING = re.compile(r"^(#+) `([a-z]+)`$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class WordHere:
    """The word at a place.

    Attributes:
        text: the whole dotted word.
        part: the part of it that the place is in.
        start, end: offsets of the whole.
        is_key: whether it is a key of a mapping.
        path: keys and indices that lead to the key, or to the value that it stands in.
    """

    text: str
    part: str
    start: int
    end: int
    is_key: bool
    path: tuple[str | int, ...]


def word_at(opened: OpenedFile, offset: int) -> WordHere | None:
    """The word that an offset is in; None between words and in comments."""
    text = opened.source.text
    number, column = opened.source.place(offset)
    line_start, line = offset - column + 1, opened.source.line(number)
    for match in _DOTTED.finditer(line):
        if line_start + match.start() <= offset <= line_start + match.end():
            break
    else:
        return None
    start, end = line_start + match.start(), line_start + match.end()
    if re.search(r"(^|\s)#", line[: match.start()]):
        return None
    part = _part(match[0], offset - start)
    follows = text[end : end + 2]
    cursor = cursor_at(text, end)
    is_key = cursor.at_key and cursor.start == start and follows[:1] == ":"
    path = (*cursor.path, match[0]) if is_key else cursor.path
    return WordHere(match[0], part, start, end, is_key, path)


def _part(text: str, at: int) -> str:
    end = text.find(".", at)
    return text[text.rfind(".", 0, at) + 1 : len(text) if end < 0 else end]


def declared_at(opened: OpenedFile, word: WordHere) -> Declared | None:
    """What a file gives under the name that the place is in; None where that is no name."""
    if opened.names is None:
        return None
    given = opened.names.declared
    path = word.path
    if word.is_key and not (len(path) == 2 and path[0] in DECLARING):
        return given.get(word.text) if "constraints" in path[:-1] else None
    # The first part of a dotted word is a name; the others are signals.
    head = word.text.partition(".")[0]
    return given.get(head) if word.part == head else None


def hover(opened: OpenedFile, offset: int) -> tuple[str, int, int] | None:
    """What is known of the word at a place, as Markdown, and its offsets."""
    word = word_at(opened, offset)
    if word is None:
        return None
    text = _of_name(opened, word) or _of_key(word) or _of_word(opened, word)
    return (text, word.start, word.end) if text else None


def is_about_all(opened: OpenedFile, offset: int) -> bool:
    """Whether a place is in a key of a task that stands for all of it: `name` or `robot`."""
    word = word_at(opened, offset)
    return word is not None and word.path in (("name",), ("robot",))


def _of_key(word: WordHere) -> str:
    if not word.is_key:
        return ""
    facts = key_at(word.path)
    if facts is None:
        return ""
    lines = [f"**{facts.name}**: {facts.title}" if facts.title else f"**{facts.name}**"]
    if facts.about:
        lines.append(facts.about)
    if facts.words:
        lines.append("One of " + ", ".join(f"`{each}`" for each in facts.words))
    for dimension in facts.dimensions:
        units = ", ".join(f"`{unit}`" for unit in fitting(dimension))
        lines.append(f"{describe(dimension)}: {units}" if units else describe(dimension))
    lines.append(_page(word.path))
    return "\n\n".join(dict.fromkeys(filter(None, lines)))


def _page(path: Sequence[str | int]) -> str:
    """A link to the section of the language's pages about the innermost key that has one."""
    sections = _sections()
    return next((sections[key] for key in reversed(path) if key in sections), "")


@cache
def _sections() -> dict[str | int, str]:
    """Links to the sections that are about one key; none where the pages are not installed."""
    found: dict[str | int, str] = {}
    for folder in (root / _PAGES for root in Path(__file__).parents):
        for page in sorted(folder.glob("*.md")):
            for match in _HEADING.finditer(page.read_text(encoding="utf-8")):
                anchor = "" if match[1] == "#" else f"#{match[2]}"
                text = f"[{_PAGES.as_posix()}/{page.name}{anchor}]({page.as_uri()}{anchor})"
                found.setdefault(match[2], text)
    return found


def _of_name(opened: OpenedFile, word: WordHere) -> str:
    declared = declared_at(opened, word)
    if declared is None:
        return ""
    span = declared.span
    where = f"{span.source}, line {span.line}" if span.source else f"line {span.line}"
    written = ""
    if declared.kind in ("param", "frame", "object") and not span.source:
        written = f"\n\n```yaml\n{opened.source.line(span.line).strip()}\n```"
    return f"**{declared.name}**: {declared.kind}, {where}{written}"


def _of_word(opened: OpenedFile, word: WordHere) -> str:
    objects = {} if opened.names is None else opened.names.objects
    parts = tuple(word.text.split("."))
    stages = () if opened.names is None else opened.names.stages
    if len(parts) > 1 and parts[0] in stages and parts[1:] != ("visits",):
        parts = parts[1:]
    entry = signals.find(parts, objects, stages)
    if entry is not None:
        meanings = entry.signal.meanings
        meaning = meanings.get(entry.member) or meanings.get(objects.get(entry.member, ""))
        unit = si_unit(entry.dimension) or "no unit"
        return f"**{word.text}**: {meaning or next(iter(meanings.values()))}, {unit}"
    if len(parts) == 1 and (vector := signals.VECTORS.get(parts[0])) is not None:
        axes = ", ".join(vector.axes)
        return f"**{word.text}**: {vector.meanings[vector.bare[0]]}; along {axes}"
    if word.text in LAWS:
        law = LAWS[word.text]
        gains = ", ".join(f"`{gain}`" for gain in law.gain_names)
        return f"**{word.text}**: a law, {law.equations}; its gains: {gains}"
    if word.text in FUNCTIONS or word.text in REDUCERS:
        return f"**{word.text}**: a function of expressions"
    return ""


def definition(opened: OpenedFile, offset: int) -> Span | None:
    """The place where the name at a place is given; None where no file gives it."""
    word = word_at(opened, offset)
    declared = None if word is None else declared_at(opened, word)
    return None if declared is None else declared.span


def renames(
    opened: OpenedFile, offset: int, text_of: Callable[[str], str]
) -> tuple[str, dict[str, list[Span]]] | None:
    """The name at a place, and its places by file; None where it cannot be renamed.

    Args:
        opened: the file; its own places stand under the empty name.
        offset: of the place.
        text_of: reads a file that it includes.
    """
    word = word_at(opened, offset)
    declared = None if word is None else declared_at(opened, word)
    if declared is None or opened.names is None:
        return None
    found = {"": opened.names.uses(declared.name, opened.source)}
    for name in sorted(opened.names.files):
        source = Source(name, text_of(name))
        own = read(source, Diagnostics(name))
        if isinstance(own, Mapping):
            found[name] = uses_in(own, declared.name, source)
    return declared.name, {name: spans for name, spans in found.items() if spans}
