"""Everything that is found about a task: by its rules, and by one trial of the file's own world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from taskspec.compiler import admit
from taskspec.examination import IN_PART, ExaminationBounds, examine
from taskspec.examined import Examination
from taskspec.program.program import refusals
from taskspec.rules import predicted
from taskspec.rules.finding import Finding, info
from taskspec.spec import FILE, LoadedTask
from taskspec.text.diagnostic import Diagnostic, Diagnostics, Severity, SpecError
from taskspec.text.source import Span
from taskspec_runner.errors import InputError
from taskspec_runner.trial.collisions import collisions
from taskspec_runner.trial.protection import fast_motions, fast_torques
from taskspec_runner.trial.reported import about, reported
from taskspec_runner.trial.trial import OPEN, Trial, trials_past_limits

#: A trial is broken off after so many ticks: at 1 kHz two minutes.
TRIAL_TICKS = 120_000


def check(loaded: LoadedTask) -> Examination:
    """The examination of a task with what its trial comes to.

    Errors refuse a task, and of one that is refused there is no trial. What a rule only predicts of
    the run is a remark where the trial ends well.

    Args:
        loaded: the task.
    """
    bounds = ExaminationBounds()
    examined = examine(loaded, bounds=bounds)
    in_part = any(each.code == IN_PART for each in examined.findings)
    if examined.plan is None or in_part or refusals(examined.findings):
        return examined
    try:
        program = admit(examined)
        trials = trials_past_limits(program, None, TRIAL_TICKS, lambda: bounds.over)
    except SpecError as error:
        return Examination(loaded, examined.plan, _sorted(loaded, error.diagnostics))
    except InputError as error:
        found = Diagnostics(loaded.source.name)
        found.extend(examined.findings)
        about(str(error)).report(loaded, found)
        return Examination(loaded, examined.plan, found.sorted())
    first, last = trials[0], trials[-1]
    in_trials = [*reported(trials)]
    lost = any(each.code == "TS521" and each.severity is Severity.WARNING for each in in_trials)
    confirmed = not first.good or first.outcome.status == OPEN or lost
    found = Diagnostics(loaded.source.name)
    found.extend(each if confirmed else _weighed(each) for each in examined.findings)
    places = [each.span for each in examined.findings if each.severity is not Severity.INFO]
    for finding in (
        *in_trials,
        *_broken_off(last),
        *fast_motions(last),
        *fast_torques(last),
    ):
        one = Diagnostics(loaded.source.name)
        finding.report(loaded, one)
        # What a rule has reported at the same place is the cause.
        found.extend(each for each in one.sorted() if not any(_is_in(s, each.span) for s in places))
    for finding in collisions(first):
        finding.report(loaded, found)
    return Examination(loaded, examined.plan, found.sorted())


def _broken_off(last: Trial) -> Iterator[Finding]:
    """That a trial did not come to its end."""
    if last.outcome.status == OPEN:
        yield info(
            IN_PART,
            f"the trial was {last.outcome.text}: what comes later was not checked",
            FILE.stages[last.outcome.stage],
            "`taskspec run` has no such bound",
        )


def _weighed(found: Diagnostic) -> Diagnostic:
    """A finding beside a trial that ends well: what was only predicted is a remark then."""
    if found.severity is Severity.ERROR or not predicted(found.code):
        return found
    message = f"{found.message}; the trial ends well"
    return replace(found, severity=Severity.INFO, message=message)


def _is_in(inner: Span | None, outer: Span | None) -> bool:
    """Whether a stretch of text is part of another one."""
    if inner is None or outer is None or inner.source != outer.source:
        return False
    begins = (outer.line, outer.column) <= (inner.line, inner.column)
    return begins and (inner.end_line, inner.end_column) <= (outer.end_line, outer.end_column)


def _sorted(loaded: LoadedTask, found: tuple[Diagnostic, ...]) -> tuple[Diagnostic, ...]:
    collected = Diagnostics(loaded.source.name)
    collected.extend(found)
    return collected.sorted()
