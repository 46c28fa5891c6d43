"""Outcome of a task file that was run as a test: a case for the run, one for each expectation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec.spec import Expectation
from taskspec.spec.expectation import titled
from taskspec.text.diagnostic import Diagnostic, Severity, SpecError
from taskspec.text.render import render
from taskspec_runner.cli.diagnostics import record
from taskspec_runner.exit_codes import WELL, WRONG
from taskspec_runner.runs import Run

#: The case of the run itself; no name of an expectation has a space.
ENDS_WELL = "ends well"


@dataclass(frozen=True, slots=True)
class CaseOutcome:
    """One case.

    Attributes:
        name: of the expectation, else its text; `ENDS_WELL` of the run itself.
        text: what is expected, as written; empty of the run itself.
        passed: whether it is so; None where that was not found out.
        message: why, in one line.
        line: of the task file, from 1.
    """

    name: str
    text: str
    passed: bool | None
    message: str = ""
    line: int | None = None

    @property
    def title(self) -> str:
        """The name, and what is expected behind it."""
        return titled(self.name, self.text) if self.text not in ("", self.name) else self.name


@dataclass(frozen=True, slots=True)
class FileOutcome:
    """A task file.

    Attributes:
        path: as it was named.
        task: the name of the task, empty where it cannot be read.
        cases: the run itself first.
        code: 0 if every case passed; else what `taskspec run` exits with.
        seconds: on the wall.
        report: of the run, empty where none was kept.
        problem: why it was not run, in full; empty if it was.
        diagnostics: findings that refused it.
    """

    path: str
    task: str
    cases: tuple[CaseOutcome, ...]
    code: int
    seconds: float = 0.0
    report: str = ""
    problem: str = ""
    diagnostics: tuple[Diagnostic, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every case did."""
        return self.code == WELL

    @property
    def failed(self) -> list[CaseOutcome]:
        """Cases that did not pass."""
        return [case for case in self.cases if case.passed is False]

    @property
    def counted(self) -> str:
        """The count of met expectations in words, or why the file was not run."""
        if self.problem:
            return self.cases[0].message
        expected = self.cases[1:]
        if not expected:
            return self.cases[0].message or "nothing is expected"
        met = sum(case.passed is True for case in expected)
        text = f"{met} of {len(expected)} expectations"
        return text if self.cases[0].passed else f"{text}; {self.cases[0].message}"

    def as_data(self) -> dict[str, Any]:
        """The outcome for other programs."""
        names = ("name", "text", "passed", "message", "line")
        return {
            "path": self.path,
            "task": self.task,
            "exit_code": self.code,
            "seconds": self.seconds,
            "report": self.report or None,
            "cases": [{name: getattr(case, name) for name in names} for case in self.cases],
            "diagnostics": [record(each) for each in self.diagnostics],
        }


def outcome_of(run: Run, path: Path, seconds: float, report: str = "") -> FileOutcome:
    """Outcome of a task file that was run.

    Args:
        run: of it.
        path: of the file, as it was named.
        seconds: that it took.
        report: of the run, where one is kept.
    """
    whole = run.summary["status"] == "done"
    faults = "; ".join(fault.line for fault in run.faults)
    why = faults if whole else str(run.summary["ending"]["text"])
    cases = [CaseOutcome(ENDS_WELL, "", whole and not faults, why if faults or not whole else "")]
    for each in run.expectations:
        # What held so far of a run that broke off might not have held to its end.
        passed = each.passed if whole or each.passed is not True else None
        name = each.name or each.text
        cases.append(CaseOutcome(name, each.text, passed, each.explanation, each.line))
    return FileOutcome(str(path), run.name, tuple(cases), run.exit_code, seconds, report)


def refused(
    path: Path,
    problem: str,
    code: int,
    *,
    message: str = "",
    diagnostics: Sequence[Diagnostic] = (),
    expected: Sequence[Expectation] = (),
    seconds: float = 0.0,
    task: str = "",
) -> FileOutcome:
    """Outcome of a task file that could not be run.

    Args:
        path: of the file, as it was named.
        problem: why, in full.
        code: exit code.
        message: why, in one line; by default, the problem.
        diagnostics: that refused it.
        expected: what would have been judged.
        seconds: that it took to find out.
        task: its name.
    """
    line = next((d.span.line for d in diagnostics if d.span is not None), None)
    first = CaseOutcome(ENDS_WELL, "", False, message or " ".join(problem.split()), line)
    rest = [CaseOutcome(e.name or e.text, e.text, None, "it was not run") for e in expected]
    given = tuple(diagnostics)
    return FileOutcome(str(path), task, (first, *rest), code, seconds, "", problem, given)


def refused_by(
    path: Path, error: SpecError, expected: Sequence[Expectation] = (), task: str = ""
) -> FileOutcome:
    """Outcome of a task file that findings refuse; see `refused`."""
    errors = [each for each in error.diagnostics if each.severity is Severity.ERROR]
    first = (errors or list(error.diagnostics))[0]
    more = f"; and {len(errors) - 1} more" if len(errors) > 1 else ""
    return refused(
        path,
        render(error.diagnostics, error.sources),
        WRONG,
        message=f"{first.code}: {first.message}{more}",
        diagnostics=error.diagnostics,
        expected=expected,
        task=task,
    )
