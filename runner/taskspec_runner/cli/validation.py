"""The validation of many files: their diagnostics, files that could not be read, the verdict."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field, replace

from taskspec.deferred_methods import dataclass
from taskspec.text.diagnostic import Diagnostic, Severity
from taskspec.text.source import Source
from taskspec_runner.exit_codes import INTERNAL, WELL, WRONG


@dataclass(frozen=True, slots=True)
class Failure:
    """A file that could not be examined.

    Attributes:
        path: the file as it was named.
        message: why, the path included.
    """

    path: str
    message: str


@dataclass(frozen=True, slots=True)
class Validation:
    """Result of validating a number of files.

    Attributes:
        files: the files that were examined, in order.
        diagnostics: by file, in the order of the files, sorted within each.
        sources: the texts of each file that places refer to.
        unreadable: files that could not be read.
        broken: files at which the validation itself failed.
        strict: whether warnings count as errors, and what could not be checked too.
        unchecked: what could not be checked here, and why; empty where all was.
        unread: folders below the named ones that could not be listed, each with why.
        worlds: what is otherwise in the worlds that were examined, a line each.
    """

    files: tuple[str, ...] = ()
    diagnostics: dict[str, tuple[Diagnostic, ...]] = field(default_factory=dict)
    sources: dict[str, dict[str, Source]] = field(default_factory=dict)
    unreadable: tuple[Failure, ...] = ()
    broken: tuple[Failure, ...] = ()
    strict: bool = False
    unchecked: str = ""
    worlds: tuple[str, ...] = ()
    unread: tuple[str, ...] = ()

    def only(self, chosen: Callable[[str], bool]) -> Validation:
        """The same with the diagnostics whose codes are chosen."""
        kept = {
            path: tuple(d for d in found if chosen(d.code))
            for path, found in self.diagnostics.items()
        }
        return replace(self, diagnostics=kept)

    def count(self, severity: Severity) -> int:
        """Number of diagnostics of a severity."""
        return sum(d.severity is severity for found in self.diagnostics.values() for d in found)

    def fails(self, diagnostic: Diagnostic) -> bool:
        """Whether a diagnostic is one that lets a file fail."""
        counted = (Severity.ERROR, Severity.WARNING) if self.strict else (Severity.ERROR,)
        return diagnostic.severity in counted

    @property
    def exit_code(self) -> int:
        """INTERNAL after an internal error, WRONG if a file is wrong or unreadable, else WELL."""
        if self.broken:
            return INTERNAL
        fails = any(self.fails(d) for found in self.diagnostics.values() for d in found)
        wrong = fails or self.unreadable or (self.strict and (self.unchecked or self.unread))
        return WRONG if wrong else WELL

    @property
    def headline(self) -> str:
        """The whole in one line, such as `3 errors, 1 warning in 2 of 14 files`."""
        counts = [(self.count(s), str(s)) for s in (Severity.ERROR, Severity.WARNING)]
        found = ", ".join(_plural(n, what) for n, what in counts if n)
        files = _plural(len(self.files), "file")
        if self.unreadable and not self.diagnostics and not self.broken:
            return f"{_plural(len(self.unreadable), 'file')} unreadable"
        if not found:
            text = f"no errors in {files}"
        elif len(self.files) == 1:
            text = f"{found} in 1 file"
        else:
            wrong = sum(
                any(d.severity is not Severity.INFO for d in found)
                for found in self.diagnostics.values()
            )
            text = f"{found} in {wrong} of {files}"
        if self.unreadable:
            text += f", {len(self.unreadable)} unreadable"
        if self.broken:
            text += f", {len(self.broken)} not validated for an internal error"
        return f"{text}; not all was checked" if self.unchecked or self.unread else text


def _plural(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
