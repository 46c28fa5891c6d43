"""The files that a task draws on beside its own."""

from __future__ import annotations

from pathlib import Path

from taskspec.program.context import Context
from taskspec.store import digest_of


def input_files(context: Context) -> dict[Path, str | None]:
    """SHA-256 of every file of a task's robot, its tables, and what it includes.

    Returns:
        By the absolute paths; None of a file that was searched and is not there.
    """
    loaded, robot = context.loaded, context.robot
    base = (loaded.base or Path()).absolute()
    files: dict[Path, str | None] = dict.fromkeys(robot.absent or ())
    files |= robot.files
    files |= loaded.included
    for stage in loaded.task.stages.values():
        if stage.path is not None and stage.path.file is not None:
            path = base / stage.path.file
            files[path] = digest_of(path)
    return files
