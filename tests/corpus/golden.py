"""Golden diagnostics: what each file of `err/` is told, kept beside it as `.out`.

A file is examined once in a process, however many tests look at what is found in it: those about
the same file go to the same process (`of_files`).

Run this file to write them anew after a change of wording, then read the difference.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cache, lru_cache
from pathlib import Path

import pytest

from taskspec.examined import Examination
from taskspec.spec import load_task
from taskspec.text.diagnostic import Diagnostic, SpecError
from taskspec.text.render import render
from taskspec.text.source import Source
from taskspec.unread import with_robot
from taskspec_runner.trial.check import check

FOLDER = Path(__file__).parent
ERRORS = sorted((FOLDER / "err").glob("*.yaml"))
GOOD = sorted((FOLDER / "ok").glob("*.yaml"))
_FINDING = re.compile(r"^(?:\S+: )?(error|warning|info)\[(TS\d{3})\]: ", re.MULTILINE)


def of_files(paths: Iterable[Path]) -> pytest.MarkDecorator:
    """Parametrises a test by files of the corpus, as `path`."""
    params = [pytest.param(p, id=p.stem, marks=pytest.mark.xdist_group(p.stem)) for p in paths]
    return pytest.mark.parametrize("path", params)


@lru_cache(maxsize=4)
def examined(path: Path) -> Examination:
    """Return a file's task with everything that is found about it.

    Raises:
        SpecError: it does not read without an error.
    """
    return check(load_task(path, overrides_of(path)))


@cache
def diagnostics_of(path: Path) -> tuple[tuple[Diagnostic, ...], Mapping[str, Source]]:
    """Return everything that is found about a task, and the texts it refers to."""
    try:
        examination = examined(path)
    except SpecError as error:
        everything = with_robot(error)
        return everything.diagnostics, everything.sources
    return examination.findings, examination.loaded.sources


def reading_of(path: Path) -> tuple[Diagnostic, ...]:
    """Return what is found in the text of a file alone."""
    return load_task(path, overrides_of(path)).warnings


def overrides_of(path: Path) -> dict[str, str]:
    """Return what the comments `# --set path=value` of a file ask for."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    pairs = (line.removeprefix("# --set ") for line in lines if line.startswith("# --set "))
    return dict(pair.split("=", 1) for pair in pairs)


def rendered(path: Path) -> str:
    """Return the diagnostics of a file as they are shown, independent of where it lies."""
    diagnostics, sources = diagnostics_of(path)
    shown = render(diagnostics, sources).replace(f"{path.parent}/", "")
    return shown.replace(f"{path.parent.parent}/", "../") + "\n"


def expected(path: Path) -> list[tuple[str, str]]:
    """Return severity and code of each finding that the golden file of a task has."""
    return _FINDING.findall(path.with_suffix(".out").read_text(encoding="utf-8"))


if __name__ == "__main__":
    for stale in (FOLDER / "err").glob("*.out"):
        stale.unlink()
    for path in ERRORS:
        path.with_suffix(".out").write_text(rendered(path), encoding="utf-8")
