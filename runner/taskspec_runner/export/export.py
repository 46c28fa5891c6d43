"""Writes the log of a run in another format, whole or not at all."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa

from taskspec_runner.errors import InputError, OutputError
from taskspec_runner.export.mcap import write_mcap
from taskspec_runner.export.poses import PoseStream
from taskspec_runner.export.rerun import write_rerun
from taskspec_runner.export.source import Source, open_source
from taskspec_runner.export.tables import write_csv, write_parquet
from taskspec_runner.record.extent import Extent
from taskspec_runner.record.folder import LOG
from taskspec_runner.record.rebuild import RebuildError, rebuild

Writer = Callable[[Source, Iterator[pa.RecordBatch], Path, PoseStream | None], None]

#: Format to its suffix.
FORMATS = {"csv": ".csv", "parquet": ".parquet", "mcap": ".mcap", "rerun": ".rrd"}
_POSED = ("mcap", "rerun")
_WRITERS: dict[str, Writer] = {
    "csv": lambda source, chunks, path, _: write_csv(source, chunks, path),
    "parquet": lambda source, chunks, path, _: write_parquet(source, chunks, path),
    "mcap": write_mcap,
    "rerun": write_rerun,
}


@dataclass(frozen=True, slots=True)
class Exported:
    """What was written.

    Attributes:
        path: of the file. extent: of the log. note: what is missing in it and why, or empty.
    """

    path: Path
    extent: Extent
    note: str = ""


@dataclass(slots=True)
class _Counted:
    """Chunks of a log, counted as they go by."""

    chunks: Iterator[pa.RecordBatch]
    ticks: int = 0
    ends: list[float] = field(default_factory=list)

    def __iter__(self) -> Iterator[pa.RecordBatch]:
        for chunk in self.chunks:
            self.ticks += chunk.num_rows
            clock = chunk.column("clock").slice(max(chunk.num_rows - 2, 0))
            self.ends = [*self.ends, *clock.to_pylist()][-2:]
            yield chunk

    @property
    def until(self) -> float:
        """Run time at the end of the last row [s]."""
        return self.ends[-1] + float(np.sum(np.diff(self.ends)))


def export_run(folder: Path, form: str, path: Path | None = None) -> Exported:
    """Writes the log of a run in one of `FORMATS`; of a partial run, what there is.

    Args:
        folder: of the run. form: the format.
        path: of the file; None for `log` with the format's suffix in the folder.

    Raises:
        InputError: the folder has no log, or a log without a tick.
        MissingLibraryError: the format needs a library that is not installed.
        OutputError: the file cannot be written.
    """
    try:
        source = open_source(folder)
    except OSError as error:
        raise InputError(f"cannot read {folder / LOG}: {error.strerror or error}") from error
    if source is None:
        raise InputError(f"{folder / LOG} holds no tick, so there is nothing to export")
    path = path or (folder / LOG).with_suffix(FORMATS[form])
    poses, note = _poses(folder) if form in _POSED else (None, "")
    counted = _Counted(source.chunks())
    partial = path.with_name(f".{path.name}.partial")
    try:
        _WRITERS[form](source, iter(counted), partial, poses)
        partial.replace(path)
    except OSError as error:
        raise OutputError.of(path, error) from error
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)
    return Exported(path, source.extent(counted.ticks, counted.until), note)


def _poses(folder: Path) -> tuple[PoseStream | None, str]:
    try:
        return PoseStream(rebuild(folder)), ""
    except RebuildError as error:
        return (
            None,
            f"without the poses of tool and task frame, as the task cannot be read: {error}",
        )
