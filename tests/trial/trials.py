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
    return check(load_text(text, "task.yaml"))


def found(text: str, code: str) -> Diagnostic:
    """The one finding of a code about a task."""
    (only,) = (each for each in checked(text).findings if each.code == code)
    return only


def serious(text: str) -> list[str]:
    """Codes of the errors and warnings about a task."""
    return [each.code for each in checked(text).findings if each.severity is not Severity.INFO]


def place_of(finding: Diagnostic, text: str) -> tuple[int, str]:
    """Line of a finding, from 1, and what of it the finding points at."""
    span = finding.span
    assert span is not None
    assert span.line == span.end_line
    line = text.splitlines()[span.line - 1]
    return span.line, line[span.column - 1 : span.end_column - 1]
