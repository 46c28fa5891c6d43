"""Diagnostics as workflow commands: GitHub shows each of them at its line of a pull request."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from taskspec.text.diagnostic import Diagnostic, Severity
from taskspec.text.render import visible
from taskspec.text.source import Span
from taskspec_runner.cli.reporters.paths import within
from taskspec_runner.cli.validation import Validation

_COMMANDS = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.INFO: "notice"}


def report(found: Validation) -> str:
    """One command a line; columns count characters from 1, the end is exclusive."""
    return "\n".join(_commands(found))


def _commands(found: Validation) -> Iterator[str]:
    for failure in (*found.unreadable, *found.broken):
        yield command("error", {"file": file_of(failure.path)}, failure.message)
    for diagnostics in found.diagnostics.values():
        for diagnostic in diagnostics:
            severity = Severity.ERROR if found.fails(diagnostic) else diagnostic.severity
            place = _place(diagnostic.span)
            properties = {"file": file_of(diagnostic.source)} | place | {"title": diagnostic.code}
            yield command(_COMMANDS[severity], properties, _message(diagnostic))


def _message(diagnostic: Diagnostic) -> str:
    parts = [diagnostic.message, diagnostic.hint]
    parts += [f"{note.message}: line {note.span.line}" for note in diagnostic.notes]
    return "\n".join(part for part in parts if part)


def _place(span: Span | None) -> dict[str, str | int]:
    if span is None:
        return {}
    if span.end_line != span.line:
        # Columns are taken only where begin and end are in one line.
        return {"line": span.line, "endLine": span.end_line}
    return {"line": span.line, "col": span.column, "endColumn": span.end_column}


def file_of(path: str) -> str:
    """A path as GitHub knows the file."""
    root = os.environ.get("GITHUB_WORKSPACE")
    inside = within(path, Path(root)) if root else None
    return path if inside is None else inside.as_posix()


def command(name: str, properties: dict[str, str | int], message: str) -> str:
    """One workflow command."""
    given = ",".join(f"{key}={_property(str(value))}" for key, value in properties.items())
    return f"::{name} {given}::{_data(message)}"


def _data(text: str) -> str:
    escaped = visible(text).replace("%", "%25").replace("\r", "%0D")
    return escaped.replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
