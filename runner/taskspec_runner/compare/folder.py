"""The folder of a comparison: what is said of all laws, and below it a run's folder for each."""

from __future__ import annotations

from pathlib import Path

from taskspec.laws import LAWS
from taskspec_runner.compare.attempt import AS_WRITTEN, folder_of
from taskspec_runner.record import folder as folders
from taskspec_runner.record.folder import RUNS, RunFolder
from taskspec_runner.record.names import COMPARISON, MANIFEST

PAGE, PICTURE = "compare.html", "compare.svg"
#: What the folder's name adds to that of the task.
_SUFFIX = "-compare"
#: The folders that runs of a comparison have.
_RUNS = (folder_of(AS_WRITTEN), *LAWS)


def open_comparison(out: Path | None, name: str) -> RunFolder:
    """Makes the folder of a new comparison.

    Args:
        out: where; an earlier comparison in it is replaced, with the runs of its laws. None for
            `runs/NAME-compare`, or with -2, -3, ... where that exists.
        name: of the task.

    Raises:
        OutputError: it cannot be made, holds something else than a comparison, or is written by
            another process.
    """
    return folders.opened(out, RUNS / f"{name}{_SUFFIX}", check_comparison, _clear)


def check_comparison(path: Path) -> None:
    """Finds out whether a comparison may be written into a folder: new, empty, or one of its own.

    Raises:
        OutputError: it may not; or another process writes into the run of a law.
    """
    own = folders.is_comparison(path / COMPARISON)
    folders.check_own(path, "comparison", own, (COMPARISON, PAGE, PICTURE))
    for law in _RUNS:
        folders.check_folder(path / law)
        folders.check_unlocked(path / law)


def _clear(path: Path) -> None:
    folders.remove(path, (COMPARISON, PAGE, PICTURE))
    for law in _RUNS:
        run = path / law
        if (run / MANIFEST).is_file():
            folders.clear(run)
            if not any(run.iterdir()):
                run.rmdir()
