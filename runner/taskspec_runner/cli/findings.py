"""Diagnostics for people, for terminals and for programs."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Iterable, Mapping
from typing import Any, TextIO

import typer

from taskspec.text.diagnostic import Diagnostic
from taskspec.text.render import headline, render
from taskspec.text.source import Source

_COLORS = {"error": "red", "warning": "yellow", "info": "cyan", "note": "cyan"}
_HEAD = re.compile(r"^(.*?: )(error|warning|info|note)(\[TS\d+\])?(: .*)$")
_SNIPPET = re.compile(r"^( *\d* \|)( *\^+)?(.*)$")


def show_findings(
    diagnostics: Iterable[Diagnostic],
    sources: Mapping[str, Source],
    *,
    concise: bool = False,
    err: bool = False,
) -> None:
    """Prints diagnostics, in full or one line each."""
    text = text_of(diagnostics, sources, concise=concise)
    if text:
        stream = sys.stderr if err else sys.stdout
        typer.echo(painted(text) if is_colored(stream) else text, err=err)


def text_of(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, Source], *, concise: bool = False
) -> str:
    """Diagnostics in full or one line each, without colours."""
    if concise:
        return "\n".join(map(headline, diagnostics))
    return render(diagnostics, sources)


def is_colored(stream: TextIO) -> bool:
    """Whether to use colours on a stream: it is a terminal and NO_COLOR is not set."""
    return stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def painted(text: str) -> str:
    """Rendered diagnostics with the colours of a terminal."""
    return "\n".join(map(_paint, text.split("\n")))


def _paint(line: str) -> str:
    if match := _HEAD.match(line):
        place, severity, code, message = match.groups(default="")
        color = _COLORS[severity]
        return (
            typer.style(place, bold=True)
            + typer.style(severity + code, fg=color, bold=True)
            + typer.style(message, bold=True)
        )
    if match := _SNIPPET.match(line):
        margin, caret, rest = match.groups(default="")
        if caret:
            return typer.style(margin, fg="blue") + typer.style(caret + rest, fg="red")
        return typer.style(margin, fg="blue") + rest
    return line


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
