"""The commands that run a world of a sweep again, and where runs of worlds are kept."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

from taskspec_runner.record.folder import Json, mapping
from taskspec_runner.record.manifest import override_words
from taskspec_runner.record.names import REPORT, TABLE, TASK
from taskspec_runner.sweep.folder import KEPT
from taskspec_runner.sweep.kept import folder_of
from taskspec_runner.sweep.world_run import Row
from taskspec_runner.sweep.worlds import RANDOM


def command_stem(said: Json, folder: Path) -> str:
    """The command that runs a world of a sweep, to which the number of the world is added.

    It is for the place where the sweep was made. A random world goes by its number under the seed;
    of a corner and a point of a grid only the table knows what they are.

    Args:
        said: what `sweep.json` says.
        folder: of the sweep.
    """
    worlds = mapping(said["worlds"])
    file = str(said["file"] or folder / TASK)
    words = ["taskspec", "run", file, *override_words(mapping(said["overrides"]))]
    if said.get("force"):
        words.append("--force")
    if worlds["kind"] == RANDOM:
        return f"{shlex.join([*words, '--seed', str(worlds['seed'])])} --world "
    return f"{shlex.join(words)} --world {shlex.quote(f'{folder / TABLE}:')}"


def kept_reports(folder: Path, rows: Sequence[Row]) -> dict[str, str]:
    """Reports of worlds that are there, relative to the sweep's folder, by the world's number."""
    runs = {path.name for path in (folder / KEPT).iterdir()} if (folder / KEPT).is_dir() else set()
    reports = {str(row["world"]): folder_of(folder, row["world"]) / REPORT for row in rows}
    return {
        world: path.relative_to(folder).as_posix()
        for world, path in reports.items()
        if path.parent.name in runs and path.is_file()
    }
