"""The folder of a comparison: what is said of all laws, and below it a run's folder for each."""

from __future__ import annotations

from pathlib import Path

from taskspec.laws import LAWS
from taskspec_runner.errors import OutputError
from taskspec_runner.record import folder as folders
from taskspec_runner.record.folder import MANIFEST, RUNS, RunFolder

COMPARISON, PAGE, PICTURE = "compare.json", "compare.html", "compare.svg"
#: What the folder's name adds to that of the task.
_SUFFIX = "-compare"


def open_comparison(out: Path | None, name: str) -> RunFolder:
    """Makes the folder of a new comparison.

    Args:
        out: where; an earlier comparison in it is replaced, with the runs of its laws. None for
            `runs/NAME-compare`, or with -2, -3, ... where that exists.
        name: of the task.

    Raises:
        OutputError: it cannot be made, or holds something else than a comparison.
    """
    usual = RUNS / f"{name}{_SUFFIX}"
    try:
        if out is None:
            return RunFolder(folders.new(usual))
        out.mkdir(parents=True, exist_ok=True)
        _clear(out)
    except OSError as error:
        raise OutputError.of(out or usual, error) from error
    return RunFolder(out)


def _clear(path: Path) -> None:
    held = {entry.name for entry in path.iterdir()}
    if held and COMPARISON not in held:
        raise OutputError(path, "the folder is not empty and holds no comparison")
    for name in (COMPARISON, PAGE, PICTURE):
        (path / name).unlink(missing_ok=True)
    for law in LAWS:
        run = path / law
        if (run / MANIFEST).is_file():
            folders.clear(run)
            if not any(run.iterdir()):
                run.rmdir()
