"""The forms in which diagnostics are reported: one module each, all of them named here."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from taskspec.deferred_methods import dataclass
from taskspec_runner.cli.formats import DiagnosticFormat
from taskspec_runner.cli.reporters import data, github, junit, sarif, text
from taskspec_runner.cli.validation import Validation


@dataclass(frozen=True, slots=True)
class Reporter:
    """One form.

    Attributes:
        report: a validation as text without a last line end, empty if there is nothing to report.
        for_programs: whether standard output is for a program, so that the line that sums up
            belongs on standard error.
    """

    report: Callable[[Validation], str]
    for_programs: bool = True


REPORTERS: Mapping[DiagnosticFormat, Reporter] = {
    DiagnosticFormat.FULL: Reporter(text.full, for_programs=False),
    DiagnosticFormat.CONCISE: Reporter(text.concise, for_programs=False),
    DiagnosticFormat.JSON: Reporter(data.report),
    DiagnosticFormat.GITHUB: Reporter(github.report),
    DiagnosticFormat.SARIF: Reporter(sarif.report),
    DiagnosticFormat.JUNIT: Reporter(junit.report),
}
"""The reporter of every form."""
