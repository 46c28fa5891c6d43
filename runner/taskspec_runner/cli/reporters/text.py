"""Diagnostics for people: with the line and a caret, or one line each."""

from __future__ import annotations

import sys

from taskspec.text.render import Line, diagnostic_lines, headline
from taskspec_runner.cli.diagnostics import text_for
from taskspec_runner.cli.validation import Validation


def full(found: Validation) -> str:
    """Every diagnostic with its line, a caret and a hint, a blank line after each."""
    lines: list[Line] = []
    for path, diagnostics in found.diagnostics.items():
        if diagnostics:
            lines += [*diagnostic_lines(diagnostics, found.sources[path]), ()]
    return text_for(sys.stdout, lines)


def concise(found: Validation) -> str:
    """One line a diagnostic: place, severity, code and message."""
    of_all = (d for diagnostics in found.diagnostics.values() for d in diagnostics)
    return text_for(sys.stdout, map(headline, of_all))
