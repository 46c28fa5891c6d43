"""A Rerun recording: every column as a scalar over simulated time, tool and task frame as poses."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pyarrow as pa

from taskspec_runner.export.missing import library
from taskspec_runner.export.poses import PoseStream
from taskspec_runner.export.source import Source, columns_of

TIMELINE = "clock"


def write_rerun(
    source: Source, chunks: Iterable[pa.RecordBatch], path: Path, poses: PoseStream | None
) -> None:
    """Writes a log as a recording; `force.z.ref` becomes the entity `signals/force/z/ref`.

    Args:
        source: the run. chunks: its log. path: the file.
        poses: gives those of tool and task frame; without, there are none.

    Raises:
        MissingLibraryError: the library rerun-sdk is not installed.
    """
    rr = library("rerun", "a Rerun recording", "rerun")
    recording = rr.RecordingStream("taskspec", make_default=False, make_thread_default=False)
    recording.save(str(path))
    units, last = source.units, ""
    for name in source.schema.names:
        if units[name]:
            label = rr.SeriesLines(names=f"{name} [{units[name]}]")
            recording.log(_entity(name), label, static=True)
    for chunk in chunks:
        rows = columns_of(chunk)
        time = rr.TimeColumn(TIMELINE, duration=rows.columns["clock"])
        for name, values in rows.columns.items():
            if name != "clock":
                scalars = rr.Scalars.columns(scalars=values)
                recording.send_columns(_entity(name), indexes=[time], columns=scalars)
        for visit in rows.visits():
            if visit.first or visit.stage != last:
                recording.set_time(TIMELINE, duration=float(rows.columns["clock"][visit.first]))
                recording.log("stage", rr.TextLog(visit.stage))
            last = visit.stage
        for name, found in zip(("tool", "task"), poses.add(rows) if poses else (), strict=False):
            known = found.known
            at = rr.TimeColumn(TIMELINE, duration=rows.columns["clock"][known])
            places = rr.Transform3D.columns(
                translation=found.places[known], quaternion=found.turns[known]
            )
            recording.send_columns(f"world/{name}", indexes=[at], columns=places)
    recording.disconnect()


def _entity(column: str) -> str:
    return "signals/" + column.replace(".", "/")
