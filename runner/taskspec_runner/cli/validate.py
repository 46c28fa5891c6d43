"""`taskspec validate`: everything that can be known about task files without running them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import typer

from taskspec.text.diagnostic import Diagnostic, Severity, SpecError
from taskspec.text.source import Source
from taskspec_runner.cli.findings import record, show_findings
from taskspec_runner.cli.formats import FindingFormat
from taskspec_runner.cli.guard import keep_trace
from taskspec_runner.cli.loading import load
from taskspec_runner.errors import InputError
from taskspec_runner.folder import MANIFEST

_SUFFIXES = (".yaml", ".yml")


@dataclass(slots=True)
class Findings:
    """What was found about a number of files.

    Attributes:
        files: how many were looked at.
        diagnostics: by file, in the order of the files, sorted within each.
        sources: the texts of each file that places refer to.
        unreadable: messages about files that could not be read.
        broken: messages about files at which the validation itself failed.
    """

    files: int = 0
    diagnostics: dict[str, tuple[Diagnostic, ...]] = field(default_factory=dict)
    sources: dict[str, dict[str, Source]] = field(default_factory=dict)
    unreadable: list[str] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)

    def count(self, severity: Severity) -> int:
        """How many findings are of a severity."""
        return sum(d.severity is severity for found in self.diagnostics.values() for d in found)

    @property
    def exit_code(self) -> int:
        """3 after an internal error, 2 if a file could not be read, 1 if one is wrong, else 0."""
        if self.broken:
            return 3
        if self.unreadable:
            return 2
        return 1 if self.count(Severity.ERROR) else 0

    @property
    def headline(self) -> str:
        """The whole in one line, such as `3 errors, 1 warning in 2 of 14 files`."""
        counts = [(self.count(s), str(s)) for s in (Severity.ERROR, Severity.WARNING)]
        found = ", ".join(_plural(n, what) for n, what in counts if n)
        files = _plural(self.files, "file")
        if self.unreadable and not self.diagnostics and not self.broken:
            return f"{_plural(len(self.unreadable), 'file')} unreadable"
        if not found:
            text = f"no errors in {files}"
        elif self.files == 1:
            text = f"{found} in 1 file"
        else:
            wrong = sum(any(d.severity is not Severity.INFO for d in found)
                        for found in self.diagnostics.values())  # fmt: skip
            text = f"{found} in {wrong} of {files}"
        if self.unreadable:
            text += f", {len(self.unreadable)} unreadable"
        if self.broken:
            text += f", {len(self.broken)} not validated for an internal error"
        return text


def validate_paths(paths: Sequence[Path], form: FindingFormat) -> int:
    """Validates files and folders and says what was found."""
    found = examine(list(task_files(paths)))
    _show(found, form)
    return found.exit_code


def task_files(paths: Sequence[Path]) -> Iterator[Path]:
    """The files among the paths, and the YAML files below the folders among them, each once.

    Hidden folders are passed over, and so are folders of runs: what they hold is a copy.

    Raises:
        InputError: a folder has none.
    """
    seen: set[Path] = set()
    for path in paths:
        found = list(_below(path)) if path.is_dir() else [path]
        if not found:
            raise InputError(f"there is no task file in {path}")
        for file in found:
            if file.resolve() not in seen:
                seen.add(file.resolve())
                yield file


def _below(folder: Path) -> Iterator[Path]:
    if (folder / MANIFEST).is_file():
        return
    for entry in sorted(folder.iterdir()):
        if entry.name.startswith("."):
            continue
        if entry.is_dir():
            yield from _below(entry)
        elif entry.suffix in _SUFFIXES:
            yield entry


def examine(files: Sequence[Path]) -> Findings:
    """Everything that is found about the files."""
    found = Findings(files=len(files))
    for path in files:
        try:
            diagnostics, sources = _examine(path)
        except InputError as error:
            found.unreadable.append(str(error))
            continue
        except Exception as error:
            # One file must not hide what is found about the others.
            trace = keep_trace(error)
            told = f"internal error: {type(error).__name__}: {' '.join(str(error).split())}"
            found.broken.append(f"{path}: {told}; please report this with {trace}")
            continue
        found.diagnostics[str(path)] = diagnostics
        found.sources[str(path)] = sources
    return found


def _examine(path: Path) -> tuple[tuple[Diagnostic, ...], dict[str, Source]]:
    try:
        loaded = load(path)
    except SpecError as error:
        return error.diagnostics, dict(error.sources)
    # A file that cannot even be read needs no robot.
    from taskspec.check import check_task

    return check_task(loaded), dict(loaded.sources)


def _show(found: Findings, form: FindingFormat) -> None:
    for message in found.unreadable:
        typer.echo(f"taskspec: {message}", err=True)
    for message in found.broken:
        typer.echo(message, err=True)
    if form is FindingFormat.JSON:
        typer.echo(json.dumps(_data(found), indent=2, ensure_ascii=False))
        return
    concise = form is FindingFormat.CONCISE
    for path, diagnostics in found.diagnostics.items():
        show_findings(diagnostics, found.sources[path], concise=concise)
        if diagnostics and not concise:
            typer.echo()
    typer.echo(found.headline)


def _data(found: Findings) -> dict[str, Any]:
    return {
        "files": found.files,
        "errors": found.count(Severity.ERROR),
        "warnings": found.count(Severity.WARNING),
        "unreadable": found.unreadable,
        "internal_errors": found.broken,
        "exit_code": found.exit_code,
        "diagnostics": [
            record(d) for diagnostics in found.diagnostics.values() for d in diagnostics
        ],
    }


def _plural(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
