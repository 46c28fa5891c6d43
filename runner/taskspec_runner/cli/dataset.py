"""`taskspec export --lerobot`: runs and sweeps as the episodes of a dataset to learn from."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import typer

from taskspec_runner.cli.options import DatasetOptions
from taskspec_runner.cli.progress import counted_line
from taskspec_runner.cli.replay import camera_place, picture_size
from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.dataset.camera import Camera
from taskspec_runner.dataset.export import export_dataset
from taskspec_runner.dataset.source import source_of
from taskspec_runner.errors import InputError
from taskspec_runner.loop.interrupt import Termination
from taskspec_runner.runs import Run

#: Frames a second, and the size of pictures, where no option says which.
FPS, SIZE = 30, "320x240"
_SMALLEST = (64, 64)


def export_episodes(folders: Sequence[Path], path: Path, given: DatasetOptions) -> int:
    """Writes a dataset and says what it holds, and which of its runs are partial or damaged.

    Args:
        folders: of runs and sweeps.
        path: of the dataset.
        given: what it holds.

    Raises:
        InputError: a folder is none, or a run cannot be an episode.
        OutputError: the dataset cannot be written.
    """
    camera, code = _camera(given), 0
    sources = [source_of(folder) for folder in folders]
    with (
        Termination(),
        counted_line("episode", shown=sys.stderr.isatty()) as line,
    ):

        def watch(run: Run, done: int, of: int) -> None:
            nonlocal code
            name = str(run.folder) if of > 1 else ""
            code = max(code, warn_of_damage(run, "its episode", name=name))
            if line is not None:
                line(done, of)

        made = export_dataset(sources, path, given.fps or FPS, camera, watch)
    for source in sources:
        if source.note:
            typer.echo(f"taskspec: {source.note}", err=True)
    counts = [
        f"{made.episodes} {'episode' if made.episodes == 1 else 'episodes'}, {made.good} good",
        f"{made.tasks} {'task' if made.tasks == 1 else 'tasks'}",
        f"{made.frames} frames at {given.fps or FPS} a second",
    ]
    typer.echo(f"{path}: {'; '.join(counts)}")
    typer.echo(f'Load it: LeRobotDataset("local/{path.resolve().name}", root="{path}")')
    return code


def _camera(given: DatasetOptions) -> Camera | None:
    """What films the runs.

    Raises:
        InputError: its place or the size of its pictures is none.
    """
    if given.camera is None:
        if given.size is not None:
            raise InputError("--size is of pictures: name a camera, such as --camera auto")
        return None
    width, height = picture_size(given.size or SIZE, _SMALLEST)
    place = None if given.camera == "auto" else camera_place(given.camera, "auto, or ")
    return Camera(width, height, place)
