"""What a rule finds.

A finding is what a rule says of a plan: its place is a path of keys, or a piece of an expression.
Located in the text of a file it becomes a `Diagnostic`, which is what is sorted, shown and
counted. Nothing else than rules makes findings; whatever reads a file knows its text and reports
diagnostics directly.
"""

from __future__ import annotations

from functools import partial

from taskspec.deferred_methods import dataclass
from taskspec.spec import KeyPath, LoadedTask
from taskspec.text.diagnostic import Diagnostics, Severity
from taskspec.text.source import Span

Place = KeyPath | Span
"""Where a finding is: a path of keys, or a piece of the text such as a part of an expression."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that a rule finds.

    Attributes:
        code: one of those of its rule.
        message: what is wrong, without a full stop.
        place: where; None where the file says nothing that could be pointed at.
        hint: what to do about it, or empty.
        notes: further places, each with what it says.
        unless: codes that say it already; where one of them is reported at the same place, or has
            a note there, the finding is left out.
        unless_at: another place at which `unless` looks; None for the finding's own.
        stops: no rule after this one is asked about the same stage.
        severity: how bad it is.
    """

    code: str
    message: str
    place: Place | None
    hint: str = ""
    notes: tuple[tuple[str, Place], ...] = ()
    unless: tuple[str, ...] = ()
    unless_at: Place | None = None
    stops: bool = False
    severity: Severity = Severity.ERROR

    def report(self, loaded: LoadedTask, diagnostics: Diagnostics) -> None:
        """Adds the finding to the diagnostics of a task, unless they say it already."""
        span = None if self.place is None else _located(self.place, loaded)
        at = span if self.unless_at is None else _located(self.unless_at, loaded)
        if self.unless and diagnostics.covers(self.unless, at):
            return
        notes = tuple((text, _located(place, loaded)) for text, place in self.notes)
        diagnostics.add(self.severity, self.code, self.message, span, self.hint, notes)


def _located(place: Place, loaded: LoadedTask) -> Span:
    return loaded.span(place) if isinstance(place, KeyPath) else place


error = partial(Finding, severity=Severity.ERROR)
warning = partial(Finding, severity=Severity.WARNING)
info = partial(Finding, severity=Severity.INFO)
