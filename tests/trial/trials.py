"""Files that are tried, and what `validate` reports of them."""

from __future__ import annotations

from functools import lru_cache

from taskspec.examined import Examination
from taskspec.spec import load_text
from taskspec.text.diagnostic import Diagnostic, Severity
from taskspec_runner.trial.check import check


@lru_cache(maxsize=64)
def checked(text: str) -> Examination:
    """Everything that is found about a task."""
    return check(load_text(text))


def found(text: str, code: str) -> Diagnostic:
    """The one finding of a code about a task."""
    (only,) = (each for each in checked(text).findings if each.code == code)
    return only


def serious(text: str) -> list[str]:
    """Codes of the errors and warnings about a task."""
    return [each.code for each in checked(text).findings if each.severity is not Severity.INFO]


def line_of(text: str, piece: str) -> int:
    """The number, from 1, of the one line of a text that has a piece."""
    (only,) = (i for i, line in enumerate(text.splitlines(), 1) if piece in line)
    return only


def place_of(finding: Diagnostic) -> tuple[int, str]:
    """Line of a finding and the text that it points at."""
    assert finding.span is not None
    span = finding.span
    line = span.source.line(span.line) if hasattr(span.source, "line") else ""
    return span.line, line[span.column - 1 : span.end_column - 1]
