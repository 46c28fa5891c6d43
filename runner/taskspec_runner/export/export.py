"""Writes the log of a run in another format, whole or not at all."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from taskspec.deferred_methods import dataclass
from taskspec_runner.errors import InputError
from taskspec_runner.export.mcap import foxglove_layout_of, write_mcap
from taskspec_runner.export.poses import PoseStream
from taskspec_runner.export.rerun import write_rerun
from taskspec_runner.export.scene import RunScene
from taskspec_runner.export.stream import LogStream
from taskspec_runner.export.tables import write_csv, write_parquet
from taskspec_runner.record.extent import Extent
from taskspec_runner.record.folder import check_target, json_text
from taskspec_runner.record.history import unrecorded_of
from taskspec_runner.record.names import LOG
from taskspec_runner.record.whole import whole
from taskspec_runner.runs import RebuildError, Run

#: Format to its suffix.
FORMATS = {"csv": ".csv", "parquet": ".parquet", "mcap": ".mcap", "rerun": ".rrd"}
_POSED = ("mcap", "rerun")
#: Suffix of the layout of Foxglove beside an MCAP file.
LAYOUT = ".foxglove.json"
_WRITERS: dict[str, Callable[[LogStream, Path], None]] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "mcap": write_mcap,
    "rerun": write_rerun,
}


@dataclass(frozen=True, slots=True)
class Exported:
    """The files that were written.

    Attributes:
        path: of the file.
        extent: of the log.
        note: what is missing in it and why, or empty.
        layout: of Foxglove's panels for it; None without one.
    """

    path: Path
    extent: Extent
    note: str = ""
    layout: Path | None = None


def export_run(
    run: Run,
    form: str,
    path: Path | None = None,
    start: float | None = None,
    end: float | None = None,
) -> Exported:
    """Writes the log of a run in one of `FORMATS`; of a partial run, what there is.

    Args:
        run: to write.
        form: the format.
        path: of the file; None for `log` with the format's suffix in the run's folder.
        start, end: run times between which ticks are written, `end` left out [s]; None for all.

    Raises:
        InputError: there is no log, or a log without a tick.
        MissingLibraryError: the format needs a library that is not installed.
        OutputError: the file cannot be written.
    """
    source = run.folder / LOG
    if form in _POSED and (start is not None or end is not None):
        # Where a frame is may follow from ticks before the window.
        raise InputError(f"--from and --to are for --csv and --parquet, not for --{form}")
    try:
        log = LogStream(run, start, end)
    except OSError as error:
        raise InputError(f"cannot read {source}: {error.strerror or error}") from error
    if not log.schema.names:
        raise InputError(f"{source} holds no tick, so there is nothing to export")
    path = path or source.with_suffix(FORMATS[form])
    check_target(path)
    note = _pose(log) if form in _POSED else ""
    with whole(path) as partial:
        _WRITERS[form](log, partial)
        if not log.ticks:
            raise InputError(f"{source} has no tick from {start or 0:g} s to {end or run.end:g} s")
    panels = foxglove_layout_of(log) if form == "mcap" else None
    if panels is None:
        return Exported(path, log.extent, note)
    layout = path.with_suffix(LAYOUT)
    check_target(layout)
    with whole(layout) as partial:
        partial.write_text(json_text(panels), encoding="utf-8")
    return Exported(path, log.extent, note, layout)


def _pose(log: LogStream) -> str:
    """Finds out where everything is; returns what is missing and why, or nothing."""
    lacking = "without arm, world, and the poses of tool and task frame"
    joints = [name for name in unrecorded_of(log.schema) if name.startswith("joint.")]
    if any(name.endswith(".position") for name in joints):
        return f"{lacking}, as joint positions were not recorded"
    try:
        log.poses = PoseStream(log.run.program)
    except RebuildError as error:
        return f"{lacking}, as the task cannot be read: {error}"
    try:
        log.scene = RunScene.of(log.run)
    except InputError as error:
        return f"without arm and world: {error}"
    return ""
