"""A Rerun recording: every column as a scalar over simulated time, tool and task frame as poses."""

from __future__ import annotations

from pathlib import Path

from taskspec_runner.export.missing import library
from taskspec_runner.export.stream import LogStream
from taskspec_runner.record.history import history_of

TIMELINE = "clock"


def write_rerun(log: LogStream, path: Path) -> None:
    """Writes a log as a recording; `force.z.ref` becomes the entity `signals/force/z/ref`.

    Raises:
        MissingLibraryError: the library rerun-sdk is not installed.
    """
    rr = library("rerun", "a Rerun recording", "rerun")
    recording = rr.RecordingStream("taskspec", make_default=False, make_thread_default=False)
    recording.save(str(path))
    last = ""
    for name, unit in log.units.items():
        if unit:
            label = rr.SeriesLines(names=f"{name} [{unit}]")
            recording.log(_entity(name), label, static=True)
    for batch in log:
        rows = history_of(batch)
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
        poses = log.poses.add(rows) if log.poses else ()
        for name, found in zip(("tool", "task", "control_point"), poses, strict=bool(poses)):
            known = found.known
            at = rr.TimeColumn(TIMELINE, duration=rows.columns["clock"][known])
            places = rr.Transform3D.columns(
                translation=found.places[known], quaternion=found.turns[known]
            )
            recording.send_columns(f"world/{name}", indexes=[at], columns=places)
    recording.disconnect()


def _entity(column: str) -> str:
    return "signals/" + column.replace(".", "/")
