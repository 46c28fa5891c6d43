"""Outcomes of task files as workflow commands: GitHub shows what was missed at its line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from taskspec_runner.cli.reporters import github
from taskspec_runner.cli.reporters.github import command, file_of
from taskspec_runner.cli.testing.outcome import FileOutcome
from taskspec_runner.cli.validation import Validation


def report(outcomes: Sequence[FileOutcome]) -> str:
    """One command a line."""
    return "\n".join(line for each in outcomes for line in _commands(each))


def _commands(outcome: FileOutcome) -> Iterator[str]:
    if outcome.diagnostics:
        found = {outcome.path: outcome.diagnostics}
        yield github.report(Validation((outcome.path,), found, {outcome.path: {}}))
        return
    for case in outcome.failed:
        properties: dict[str, str | int] = {"file": file_of(outcome.path)}
        if case.line is not None:
            properties["line"] = case.line
        properties["title"] = case.name
        text = case.message if case.text in ("", case.name) else f"{case.text}: {case.message}"
        yield command("error", properties, text)
