"""Changes of a text that a finding's hint asks for."""

from __future__ import annotations

import re
from collections.abc import Iterator

from taskspec.deferred_methods import dataclass
from taskspec.text.diagnostic import Diagnostic
from taskspec.text.source import Source
from taskspec.text.units import DIGITS, UNIT

_MEANT = re.compile(r"did you mean '([^']+)'\?")
_QUOTED = re.compile(r"'([^']+)'")
_WRITE = re.compile(r"\bwrite '([^']+)'")
_LISTED = re.compile(r"^(?:one of|known here|[a-z ]+s): ((?:[\w.-]+, )*[\w.-]+)$")
_MISSING = re.compile(r"^add a unit: (.+)$")
_FITTING = re.compile(r"^(?:units that fit:|it has to come out in) (.+)$")
_SUCH_AS = re.compile(r"^such as (\d+|\[[^{}]+\])(?:,|$)")
_REMOVE = re.compile(r"leave it out|keep one of the two|^delete it")
_COLON, _TABS, _COLUMN = "a key ends with ': '", "a tab", "lines of one level begin in one column"
#: A text up to its last number, which may have a unit behind it.
_NUMBER = re.compile(rf"(.*?{DIGITS})\s*(?:{UNIT})?$")
_PARTS = re.compile(r", | or ")
#: Of a list of words, those that are offered.
_OFFERED = 6


@dataclass(frozen=True, slots=True)
class Fix:
    """A change of a text.

    Attributes:
        title: what it does.
        start, end: offsets of what is replaced.
        text: what takes its place.
        only: whether the hint names no other.
    """

    title: str
    start: int
    end: int
    text: str
    only: bool


def fixes(finding: Diagnostic, source: Source) -> list[Fix]:
    """What can be changed where a finding stands; empty where its hint is no text to write."""
    span = finding.span
    if span is None or finding.source != source.name or span.source:
        return []
    start = source.offset(span.line, span.column)
    end = source.offset(span.end_line, span.end_column)
    written = source.text[start:end]
    texts = [
        text
        for text in dict.fromkeys(_texts(finding.message, finding.hint, written))
        if text != written
    ]
    found = [
        Fix(f"Write {text} for {written}", start, end, text, only=len(texts) == 1) for text in texts
    ]
    if _REMOVE.search(finding.hint):
        found += _removed(source, start, end)
    found += _spaced(finding, source, start)
    return found


def _texts(message: str, hint: str, written: str) -> Iterator[str]:
    if meant := _MEANT.search(hint) or _WRITE.search(hint):
        # Of a dotted path the message quotes the step that is meant.
        wrong = _QUOTED.search(message)
        steps = written.split(".")
        if wrong is not None and wrong[1] in steps and "." not in meant[1]:
            yield ".".join(meant[1] if step == wrong[1] else step for step in steps)
        else:
            yield meant[1]
    elif match := _LISTED.match(hint):
        yield from match[1].split(", ")[:_OFFERED]
    elif match := _MISSING.match(hint):
        yield from (f"{written} {unit}" for unit in _PARTS.split(match[1]))
    elif (match := _FITTING.match(hint)) and (number := _NUMBER.match(written)):
        yield from (f"{number[1]} {unit}" for unit in _PARTS.split(match[1]))
    elif (match := _SUCH_AS.match(hint)) and not written.startswith("["):
        yield match[1]


def _spaced(finding: Diagnostic, source: Source, start: int) -> Iterator[Fix]:
    """Puts the spaces and the colon of a line where they belong."""
    number, column = source.place(start)
    line, line_start = source.line(number), start - column + 1
    indent = len(line) - len(line.lstrip(" \t"))
    if finding.message == _TABS and column <= indent:
        for spaces in (4, 2):
            text = line[:indent].replace("\t", " " * spaces)
            title = f"Write {spaces} spaces for a tab"
            yield Fix(title, line_start, line_start + indent, text, only=False)
    elif finding.hint == _COLON and (key := re.match(r"[\w-]+(?= )", line[indent:])):
        end = line_start + indent + len(key[0])
        yield Fix(f"Write {key[0]}:", end, end, ":", only=True)
    elif finding.hint == _COLUMN:
        above = (source.line(each) for each in range(1, number))
        columns = {len(each) - len(each.lstrip(" ")) for each in above if each.strip()}
        for at in sorted(columns, key=lambda each: (abs(each - indent), each))[:2]:
            title = f"Begin the line in column {at + 1}"
            yield Fix(title, line_start, line_start + indent, " " * at, only=False)


def _removed(source: Source, start: int, end: int) -> Iterator[Fix]:
    """Leaves out the entry that begins at a place, if it stands in one line."""
    number, column = source.place(start)
    line, below, indent = source.line(number), source.line(number + 1), column - 1
    line_start = start - indent
    line_end = line_start + len(line)
    if line[:indent].strip():
        yield from _removed_from_braces(source, start, end, line_end)
        return
    if below.strip() and len(below) - len(below.lstrip()) > indent:
        return
    after = min(line_end + 1, len(source.text))
    yield Fix(f"Leave out {line.strip()}", line_start, after, "", only=False)


def _removed_from_braces(source: Source, start: int, end: int, line_end: int) -> Iterator[Fix]:
    """The same of an entry between braces: with the comma after it, or the one before it."""
    text, depth, at = source.text, 0, end
    while at < line_end and (depth or text[at] not in ",}]"):
        depth += {"{": 1, "[": 1, "}": -1, "]": -1}.get(text[at], 0)
        at += 1
    if at >= line_end:
        return
    first = start
    if text[at] == ",":
        at += 1
        while at < line_end and text[at] == " ":
            at += 1
    elif text[:start].rstrip().endswith(","):
        first = len(text[:start].rstrip()) - 1
    yield Fix(f"Leave out {text[start:at].strip(' ,')}", first, at, "", only=False)
