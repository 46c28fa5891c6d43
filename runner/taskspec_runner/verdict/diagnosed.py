"""Findings about a task as a run keeps them: without the place of the file on a machine."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from taskspec.spec import LoadedTask
from taskspec.spec.include import shown_from
from taskspec.text.diagnostic import Diagnostic
from taskspec.text.source import Span


def diagnosed(found: Iterable[Diagnostic], loaded: LoadedTask) -> list[dict[str, Any]]:
    """Findings as data.

    Args:
        found: about the task.
        loaded: the task.

    Returns:
        `code`, `severity`, `message`, `hint`, and the place: `line` and `column` from 1 in the
        task file, both None in another text, which `source` names.
    """
    return [
        {
            "code": each.code,
            "severity": str(each.severity),
            "message": each.message,
            "hint": each.hint,
            "source": (
                ""
                if each.source == loaded.source.name
                else shown_from(each.source, loaded.source.name)
            ),
            "line": line_of(each.span) if each.source == loaded.source.name else None,
            "column": each.span.column if line_of(each.span) and each.span else None,
        }
        for each in found
    ]


def line_of(span: Span | None) -> int | None:
    """The line of a place in the task file, None elsewhere."""
    return span.line if span is not None and not span.source else None
