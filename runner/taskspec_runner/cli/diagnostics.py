"""Diagnostics for people, for terminals and for programs."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from typing import Any, TextIO

import typer

from taskspec.text.diagnostic import Diagnostic
from taskspec.text.render import Line, Style, diagnostic_lines, headline, plain
from taskspec.text.source import Source

_STYLES: Mapping[Style, Mapping[str, Any]] = {
    Style.PLACE: {"bold": True},
    Style.ERROR: {"fg": "red", "bold": True},
    Style.WARNING: {"fg": "yellow", "bold": True},
    Style.INFO: {"fg": "cyan", "bold": True},
    Style.NOTE: {"fg": "cyan", "bold": True},
    Style.MESSAGE: {"bold": True},
    Style.MARGIN: {"fg": "blue"},
    Style.CARET: {"fg": "red"},
}
"""How a terminal shows each style; what is not named is shown as it is."""


def show_diagnostics(
    diagnostics: Iterable[Diagnostic],
    sources: Mapping[str, Source],
    *,
    concise: bool = False,
    err: bool = False,
) -> None:
    """Prints diagnostics, in full or one line each."""
    lines = map(headline, diagnostics) if concise else diagnostic_lines(diagnostics, sources)
    text = text_for(sys.stderr if err else sys.stdout, lines)
    if text:
        typer.echo(text, err=err)


def text_for(stream: TextIO, rendered: Iterable[Line]) -> str:
    """Rendered lines for a stream: with colours where it shows them."""
    if not is_colored(stream):
        return plain(rendered)
    return "\n".join("".join(_painted(*piece) for piece in line) for line in rendered)


def is_colored(stream: TextIO) -> bool:
    """Whether to use colours on a stream: NO_COLOR, then FORCE_COLOR, then a terminal says so."""
    if os.environ.get("NO_COLOR"):
        return False
    return forces_color() or (stream.isatty() and os.environ.get("TERM") != "dumb")


def forces_color() -> bool:
    """Whether the environment asks for colours where no terminal is."""
    given = (os.environ.get(name) for name in ("FORCE_COLOR", "CLICOLOR_FORCE"))
    return not os.environ.get("NO_COLOR") and any(value not in (None, "", "0") for value in given)


def _painted(text: str, style: Style) -> str:
    return typer.style(text, **_STYLES[style]) if style in _STYLES else text


def record(diagnostic: Diagnostic) -> dict[str, Any]:
    """A diagnostic as data; lines and columns count from 1, the end is exclusive."""
    return {
        "code": diagnostic.code,
        "severity": str(diagnostic.severity),
        "message": diagnostic.message,
        "file": diagnostic.source,
        **_place(diagnostic.span),
        "hint": diagnostic.hint,
        "notes": [
            {"message": note.message, "file": note.source, **_place(note.span)}
            for note in diagnostic.notes
        ],
    }


def _place(span: Any) -> dict[str, int | None]:
    parts = ("line", "column", "end_line", "end_column")
    return {part: getattr(span, part) if span else None for part in parts}
