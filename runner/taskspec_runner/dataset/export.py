"""Runs as a LeRobot dataset: an episode a run, with the log of every tick beside the frames."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from taskspec.deferred_methods import dataclass
from taskspec_runner.dataset.camera import Camera
from taskspec_runner.dataset.features import FrameLayout
from taskspec_runner.dataset.frames import RunFrames, layout_of
from taskspec_runner.dataset.source import RunSource
from taskspec_runner.dataset.statistics import Colours
from taskspec_runner.dataset.writer import LOGS, DatasetWriter
from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.export.stream import LogStream
from taskspec_runner.export.tables import write_parquet
from taskspec_runner.record.folder import mapping
from taskspec_runner.record.whole import whole_folder
from taskspec_runner.runs import Run

#: What is called when an episode is written: its run, how many there are, and of how many.
Watch = Callable[[Run, int, int], None]


@dataclass(frozen=True, slots=True)
class ExportedDataset:
    """A dataset that was written.

    Attributes:
        path: its folder.
        episodes, frames, tasks: how many.
        good: episodes that met what their task files expect.
    """

    path: Path
    episodes: int
    frames: int
    tasks: int
    good: int


def export_dataset(
    sources: Sequence[RunSource],
    path: Path,
    fps: int = 30,
    camera: Camera | None = None,
    watch: Watch | None = None,
) -> ExportedDataset:
    """Writes runs as the episodes of a LeRobot dataset, format v3.0, whole or not at all.

    Args:
        sources: of the runs, all of one robot.
        path: the folder, which is new or empty.
        fps: frames a second.
        camera: films the runs; None without pictures.
        watch: is called when an episode is written.

    Raises:
        InputError: a run cannot be an episode, or not of the same dataset as the first one.
        NoCanvasError: there is nothing to draw with.
        MissingLibraryError: a video needs a library that is not installed.
        OutputError: the folder cannot be written, or something is in it.
    """
    _check_empty(path)
    if camera is not None:
        camera.check()
    good, total, colours = 0, sum(map(len, sources)), Colours()
    with whole_folder(path) as root:
        writer, first = None, ""
        for name, run in chain.from_iterable(source.runs() for source in sources):
            size = None if camera is None else (camera.height, camera.width)
            layout = layout_of(run, fps, size)
            if writer is None:
                writer, first = DatasetWriter(root, layout), name
            _check_same(layout, name, writer.layout, first)
            colours += _add(writer, run, name, camera)
            good += run.passed
            if watch is not None:
                watch(run, writer.episodes, total)
        if writer is None:
            raise InputError("there is no run to export: every world broke")
        writer.finish(colours.statistics() if camera is not None else None)
    return ExportedDataset(path, writer.episodes, writer.frames, len(writer.tasks), good)


def _check_empty(path: Path) -> None:
    try:
        held = any(path.iterdir())
    except FileNotFoundError:
        return
    except OSError as error:
        raise OutputError.of(path, error) from error
    if held:
        what = "the folder is not empty; name a new one"
        raise OutputError(path, f"{what}. LeRobot's lerobot-edit-dataset merges datasets")


def _check_same(layout: FrameLayout, name: str, other: FrameLayout, first: str) -> None:
    def words(of: FrameLayout) -> str:
        live = f" with {', '.join(of.live)}" if of.live else ""
        return f"{of.robot} with {of.joints} joints at {of.rate:g} Hz{live}"

    if layout != other:
        raise InputError(
            f"{name} is a run of {words(layout)}, {first} of {words(other)}; a dataset has one "
            "robot, one rate and the same live params: export them into folders of their own"
        )


def _add(writer: DatasetWriter, run: Run, name: str, camera: Camera | None) -> Colours:
    """Writes a run as the next episode; returns the colours of its pictures."""
    frames = RunFrames(run, writer.layout)
    columns = frames.columns()
    log = writer.log_path()
    write_parquet(LogStream(run), log)
    colours = Colours()
    if camera is not None:
        colours = camera.film(frames, writer.video_path())
    task = run.program.context.loaded.task
    pictures = colours.statistics() if camera is not None else None
    writer.add(columns, task.about or task.name, facts_of(run, name, log), pictures)
    return colours


def facts_of(run: Run, name: str, log: Path) -> dict[str, Any]:
    """What the table of episodes says of a run.

    Args:
        run: of the episode.
        name: of the run.
        log: its log in the dataset.
    """
    manifest = run.manifest
    world = mapping(manifest.get("world"))
    return {
        "taskspec/log": f"{LOGS}/{log.name}",
        "taskspec/rows": len(run),
        "taskspec/run": name,
        "taskspec/task": run.name,
        "taskspec/success": run.passed,
        "taskspec/verdict": run.verdict,
        "taskspec/status": run.extent.status,
        "taskspec/seed": manifest.get("seed"),
        "taskspec/world": json.dumps(world),
        "taskspec/overrides": json.dumps(mapping(manifest.get("overrides"))),
        "taskspec/versions": json.dumps(mapping(manifest.get("versions"))),
    }
