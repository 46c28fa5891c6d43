"""Golden diagnostics: what each file of `err/` is told, kept beside it as `.out`.

Run this file to write them anew after a change of wording, then read the difference.
"""

from __future__ import annotations

from pathlib import Path

from taskspec.examination import check_task
from taskspec.spec import load_task
from taskspec.text.diagnostic import Diagnostic, SpecError
from taskspec.text.render import render
from taskspec.text.source import Source

FOLDER = Path(__file__).parent
ERRORS = sorted((FOLDER / "err").glob("*.yaml"))
GOOD = sorted((FOLDER / "ok").glob("*.yaml"))


def diagnostics_of(path: Path) -> tuple[tuple[Diagnostic, ...], dict[str, Source]]:
    """Return everything that is found about a task, and the texts it refers to.

    What needs robot and start is found only in a file that reads without an error.
    """
    try:
        loaded = load_task(path, overrides_of(path))
    except SpecError as error:
        return error.diagnostics, dict(error.sources)
    return check_task(loaded), dict(loaded.sources)


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
    return render(diagnostics, sources).replace(str(path), path.name) + "\n"


if __name__ == "__main__":
    for stale in (FOLDER / "err").glob("*.out"):
        stale.unlink()
    for path in ERRORS:
        path.with_suffix(".out").write_text(rendered(path), encoding="utf-8")
