"""Findings for people: with the line and a caret, or one line each."""

from __future__ import annotations

import sys

from taskspec_runner.cli.examined import Findings
from taskspec_runner.cli.findings import is_colored, painted, text_of


def full(found: Findings) -> str:
    """Every finding with its line, a caret and a hint, a blank line after each."""
    parts = [
        text_of(diagnostics, found.sources[path])
        for path, diagnostics in found.diagnostics.items()
        if diagnostics
    ]
    return _shown("\n\n".join(parts) + "\n" if parts else "")


def concise(found: Findings) -> str:
    """One line a finding: place, severity, code and message."""
    parts = [
        text_of(diagnostics, found.sources[path], concise=True)
        for path, diagnostics in found.diagnostics.items()
        if diagnostics
    ]
    return _shown("\n".join(parts))


def _shown(text: str) -> str:
    return painted(text) if is_colored(sys.stdout) else text
