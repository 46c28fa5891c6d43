"""Diagnostics: what is wrong, where in a text, and what to do about it.

What a rule finds about a plan is a `taskspec.rules.Finding` until its place is found in the
text of the file; from there on, and for everything that reading a file reports, it is a diagnostic.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from enum import StrEnum

from taskspec.deferred_methods import dataclass
from taskspec.text.codes import CODES
from taskspec.text.source import Source, Span


class Severity(StrEnum):
    """How bad a diagnostic is; only errors keep a task from running."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


@dataclass(frozen=True, slots=True)
class Note:
    """A second place that belongs to a diagnostic, such as a first definition."""

    message: str
    source: str
    span: Span


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One thing that is wrong with a text.

    Attributes:
        code: stable; `taskspec.text.codes` has its title.
        severity: how bad it is.
        message: what is wrong, without a full stop.
        source: name of the text.
        span: the place in it; None where there is nothing to point at.
        hint: what to do about it, or empty.
        notes: second places.
    """

    code: str
    severity: Severity
    message: str
    source: str
    span: Span | None
    hint: str = ""
    notes: tuple[Note, ...] = ()


class SpecError(Exception):
    """A task file is wrong.

    Attributes:
        diagnostics: all findings, sorted by place; at least one is an error.
        sources: the texts that the places refer to, by name.
    """

    def __init__(
        self, diagnostics: Iterable[Diagnostic], sources: Mapping[str, Source] | None = None
    ) -> None:
        self.diagnostics = tuple(diagnostics)
        self.sources: Mapping[str, Source] = dict(sources or {})
        super().__init__("; ".join(f"{d.code}: {d.message}" for d in self.diagnostics))

    def __reduce__(self) -> tuple[type[SpecError], tuple[object, ...]]:
        return (SpecError, (self.diagnostics, dict(self.sources)))


class Diagnostics:
    """Collects findings about one source; equal ones are kept once."""

    def __init__(self, source: str) -> None:
        self.source = source
        self._found: dict[Diagnostic, None] = {}

    def covers(self, codes: tuple[str, ...], span: Span | None) -> bool:
        """Whether a finding of one of these codes is already there, or has a note there."""
        return span is not None and any(
            d.code in codes and span in (d.span, *(note.span for note in d.notes))
            for d in self._found
        )

    def error(
        self,
        code: str,
        message: str,
        span: Span | None,
        hint: str = "",
        notes: tuple[tuple[str, Span], ...] = (),
    ) -> None:
        """Adds an error; `notes` are further (message, place) pairs."""
        self.add(Severity.ERROR, code, message, span, hint, notes)

    def warning(
        self,
        code: str,
        message: str,
        span: Span | None,
        hint: str = "",
        notes: tuple[tuple[str, Span], ...] = (),
    ) -> None:
        """Adds a warning; `notes` are further (message, place) pairs."""
        self.add(Severity.WARNING, code, message, span, hint, notes)

    def info(
        self,
        code: str,
        message: str,
        span: Span | None,
        hint: str = "",
        notes: tuple[tuple[str, Span], ...] = (),
    ) -> None:
        """Adds a remark; `notes` are further (message, place) pairs."""
        self.add(Severity.INFO, code, message, span, hint, notes)

    def add(
        self,
        severity: Severity,
        code: str,
        message: str,
        span: Span | None,
        hint: str = "",
        notes: tuple[tuple[str, Span], ...] = (),
    ) -> None:
        """Adds a finding of any severity.

        Raises:
            AssertionError: the code is not registered.
        """
        assert code in CODES, f"diagnostic code {code} is not registered"
        led = span.via if span is not None else ()
        found = Diagnostic(
            code,
            severity,
            message,
            self._name(span),
            span,
            hint,
            tuple(Note(text, self._name(place), place) for text, place in (*notes, *led)),
        )
        self._found.setdefault(found)

    def extend(self, diagnostics: Iterable[Diagnostic]) -> None:
        """Adds findings that are already complete."""
        for diagnostic in diagnostics:
            self._found.setdefault(diagnostic)

    def sorted(self) -> tuple[Diagnostic, ...]:
        """The findings by source and place; those without a place first.

        Equal findings about several uses of one text are reported once, with all their notes.
        """
        reported: dict[Diagnostic, dict[Note, None]] = {}
        for found in self._found:
            span = found.span and replace(found.span, via=())
            notes = reported.setdefault(replace(found, span=span, notes=()), {})
            notes.update(dict.fromkeys(found.notes))
        return in_order(replace(found, notes=tuple(notes)) for found, notes in reported.items())

    @property
    def has_errors(self) -> bool:
        """Whether any finding is an error."""
        return any(d.severity is Severity.ERROR for d in self._found)

    def __len__(self) -> int:
        return len(self._found)

    def _name(self, span: Span | None) -> str:
        return span.source if span is not None and span.source else self.source


def in_order(found: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Findings by source and place, equal ones once; those without a place first."""
    return tuple(sorted(dict.fromkeys(found), key=_order))


def _order(diagnostic: Diagnostic) -> tuple[str, int, int, str, str]:
    span = diagnostic.span
    line, column = (span.line, span.column) if span else (0, 0)
    return (diagnostic.source, line, column, diagnostic.code, diagnostic.message)
