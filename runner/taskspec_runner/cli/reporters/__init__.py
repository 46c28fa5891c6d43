"""The forms in which findings about files are told: one module each, all of them named here."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from taskspec_runner.cli.examined import Findings
from taskspec_runner.cli.formats import FindingFormat
from taskspec_runner.cli.reporters import data, github, junit, sarif, text


@dataclass(frozen=True, slots=True)
class Reporter:
    """One form.

    Attributes:
        report: findings as a text without a last line end, empty if there is nothing to tell.
        for_programs: whether standard output is for a program, so that the line that sums up
            belongs on standard error.
    """

    report: Callable[[Findings], str]
    for_programs: bool = True


REPORTERS: Mapping[FindingFormat, Reporter] = {
    FindingFormat.FULL: Reporter(text.full, for_programs=False),
    FindingFormat.CONCISE: Reporter(text.concise, for_programs=False),
    FindingFormat.JSON: Reporter(data.report),
    FindingFormat.GITHUB: Reporter(github.report),
    FindingFormat.SARIF: Reporter(sarif.report),
    FindingFormat.JUNIT: Reporter(junit.report),
}
"""The reporter of every form."""
