"""Diagnostics as text: the place, the line it is in, a caret and a hint."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping

from taskspec.text.diagnostic import Diagnostic, Note
from taskspec.text.source import Source, Span

_WIDTH = 120
"""Longer lines are cut around the caret."""


def render(diagnostics: Iterable[Diagnostic], sources: Mapping[str, Source]) -> str:
    """Return every diagnostic in full, separated by blank lines.

    Args:
        diagnostics: what was found.
        sources: the texts by name; a diagnostic without its text is shown without a snippet.
    """
    return "\n\n".join(render_one(d, sources.get(d.source), sources) for d in diagnostics)


def render_one(
    diagnostic: Diagnostic, source: Source | None, sources: Mapping[str, Source] | None = None
) -> str:
    """Return one diagnostic in full: header, snippet with caret and hint, second places."""
    lines = [headline(diagnostic)]
    if source is None or diagnostic.span is None:
        if diagnostic.hint:
            lines.append("   = " + visible(diagnostic.hint).replace("\n", "\n   | "))
    else:
        lines += _snippet(source, diagnostic.span, diagnostic.hint)
    for note in diagnostic.notes:
        lines += _note(note, (sources or {}).get(note.source))
    return "\n".join(lines)


def headline(diagnostic: Diagnostic) -> str:
    """Return `file:line:column: severity[code]: message`."""
    return (
        f"{_place(diagnostic.source, diagnostic.span)}: "
        f"{diagnostic.severity}[{diagnostic.code}]: {_on_one_line(diagnostic.message)}"
    )


def visible(text: str) -> str:
    """Return the text with everything that could move a terminal's cursor written as an escape."""
    if text.isprintable():
        return text
    return "".join(
        c if c == "\n" or c.isprintable() else c.encode("unicode_escape").decode() for c in text
    )


def _on_one_line(text: str) -> str:
    # A line that begins with what a file says may be a command to whoever reads the log of a CI.
    return visible(text).replace("\n", "\\n")


def _place(source: str, span: Span | None) -> str:
    name = _on_one_line(source)
    return f"{name}:{span.line}:{span.column}" if span else name


def _note(note: Note, source: Source | None) -> list[str]:
    lines = [f"{_place(note.source, note.span)}: note: {_on_one_line(note.message)}"]
    return lines + (_snippet(source, note.span, "") if source else [])


def _snippet(source: Source, span: Span, hint: str) -> list[str]:
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
    caret = " " * _columns(before) + "^" * max(_columns(token), 1)
    first, *rest = visible(hint).split("\n")
    return [
        f"{margin} |",
        f"{number} | {before}{token}{after}".rstrip(),
        f"{margin} | {caret} {first}".rstrip(),
        *(
            f"{margin} | {' ' * _columns(before)}{' ' * (len(caret) - _columns(before))} {line}"
            for line in rest
        ),
    ]


def _columns(text: str) -> int:
    """Return the terminal columns of the text: wide characters take two, combining ones none."""
    if text.isascii():
        return len(text)
    return sum(
        0 if unicodedata.combining(c) else 2 if unicodedata.east_asian_width(c) in "WF" else 1
        for c in text
    )
