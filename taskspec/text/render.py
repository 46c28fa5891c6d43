"""Diagnostics as lines of styled text: the place, the line it is in, a caret and a hint.

This is the only place that lays a diagnostic out. Terminals colour the pieces, everything else
takes them plain.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum

from taskspec.text.characters import escaped
from taskspec.text.diagnostic import Diagnostic
from taskspec.text.source import Source, Span

_WIDTH = 120
"""Longer lines are cut around the caret."""


class Style(StrEnum):
    """What a piece of a rendered diagnostic is; each output gives it a look of its own."""

    PLAIN = "plain"
    PLACE = "place"
    ERROR = "error"
    WARNING = "warning"
    INFO = "info"
    NOTE = "note"
    MESSAGE = "message"
    MARGIN = "margin"
    CARET = "caret"


Line = tuple[tuple[str, Style], ...]
"""A line as its pieces, from the left."""


def render(diagnostics: Iterable[Diagnostic], sources: Mapping[str, Source]) -> str:
    """Every diagnostic in full, separated by blank lines.

    Args:
        diagnostics: what was found.
        sources: the texts by name; a diagnostic without its text is shown without a snippet.
    """
    return plain(diagnostic_lines(diagnostics, sources))


def plain(rendered: Iterable[Line]) -> str:
    """Lines without their styles."""
    return "\n".join("".join(text for text, _ in line) for line in rendered)


def diagnostic_lines(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, Source]
) -> Iterator[Line]:
    """The lines of every diagnostic in full, a blank one between two.

    A diagnostic is a header, a snippet with caret and hint, and its second places.
    """
    for number, diagnostic in enumerate(diagnostics):
        if number:
            yield ()
        yield headline(diagnostic)
        source = sources.get(diagnostic.source)
        if source is not None and diagnostic.span is not None:
            yield from _snippet(source, diagnostic.span, diagnostic.hint)
        elif diagnostic.hint:
            first, *rest = visible(diagnostic.hint).split("\n")
            yield ((f"   = {first}", Style.PLAIN),)
            yield from ((("   |", Style.MARGIN), (f" {line}", Style.PLAIN)) for line in rest)
        for note in diagnostic.notes:
            yield _header(note.source, note.span, Style.NOTE, "", note.message)
            if (text := sources.get(note.source)) is not None:
                yield from _snippet(text, note.span, "")


def headline(diagnostic: Diagnostic) -> Line:
    """`file:line:column: severity[code]: message`."""
    style = Style(diagnostic.severity.value)
    code = f"[{diagnostic.code}]"
    return _header(diagnostic.source, diagnostic.span, style, code, diagnostic.message)


def visible(text: str) -> str:
    """The text with everything that could move a terminal's cursor written as an escape."""
    return "\n".join(map(escaped, text.split("\n")))


def _header(source: str, span: Span | None, style: Style, code: str, message: str) -> Line:
    # A line that begins with what a file says may be a command to whoever reads the log of a CI.
    place = escaped(source)
    if span is not None:
        place = f"{place}:{span.line}:{span.column}"
    return (
        (f"{place}: ", Style.PLACE),
        (f"{style}{code}", style),
        (f": {escaped(message)}", Style.MESSAGE),
    )


def _snippet(source: Source, span: Span, hint: str) -> Iterator[Line]:
    full = source.line(span.line)
    start = min(max(span.column - 1, 0), len(full))
    end = span.end_column - 1 if span.end_line == span.line else len(full)
    end = min(max(end, start + 1), max(len(full), start + 1))
    cut = max(0, min(start - _WIDTH // 2, len(full) - _WIDTH))
    shown = full[cut : cut + _WIDTH]
    end = min(end, cut + _WIDTH)
    prefix = "…" if cut else ""
    suffix = "…" if cut + _WIDTH < len(full) else ""
    before = prefix + visible(shown[: start - cut])
    token = visible(shown[start - cut : end - cut])
    after = visible(shown[end - cut :]) + suffix
    number = str(span.line)
    margin = " " * len(number)
    indent, caret = " " * _columns(before), "^" * max(_columns(token), 1)
    first, *rest = visible(hint).split("\n")
    yield _in_margin(margin, "")
    yield _in_margin(number, f" {before}{token}{after}")
    yield _in_margin(margin, f" {indent}{caret} {first}", Style.CARET)
    for line in rest:
        yield _in_margin(margin, f" {indent}{' ' * len(caret)} {line}")


def _in_margin(number: str, text: str, style: Style = Style.PLAIN) -> Line:
    margin, text = f"{number} |", text.rstrip()
    return ((margin, Style.MARGIN), (text, style)) if text else ((margin, Style.MARGIN),)


def _columns(text: str) -> int:
    """The terminal columns of the text: wide characters take two, combining ones none."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1
        for c in text
    )
