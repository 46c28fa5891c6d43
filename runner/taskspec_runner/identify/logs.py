"""The logs that something is identified from: folders of runs, and what was recorded elsewhere."""

from __future__ import annotations

from pathlib import Path

from taskspec.program.program import Program
from taskspec_runner.errors import InputError
from taskspec_runner.record.folder import RunFolder
from taskspec_runner.record.history import History
from taskspec_runner.runs import Run


def open_log(program: Program, path: Path, columns: Path | None = None) -> History:
    """The ticks of a log.

    Args:
        program: of the task.
        path: the folder of a run; or a CSV, Parquet or MCAP file.
        columns: of a file: its column map, or the name of a ready one; None where it has the
            columns of a run.

    Raises:
        InputError: it cannot be read, or is not of this task.
    """
    if path.is_dir() or RunFolder(path).is_run:
        history = Run.load(path).history
        if not len(history):
            raise InputError(f"cannot identify from {path}: its log holds no tick")
    else:
        from taskspec_runner.recorded.column_map import read_columns
        from taskspec_runner.recorded.recording import read_recording

        history = read_recording(program, path, read_columns(columns)).history
    check_log(program, history, str(path))
    return history


def check_log(program: Program, history: History, name: str) -> None:
    """Finds out whether a log is of a task.

    Raises:
        InputError: it has other stages, or another arm.
    """
    n = program.context.robot.n
    joints = sum(f"joint.{i + 1}.position" in history.columns for i in range(64))
    if joints not in (0, n):
        raise InputError(
            f"{name} is of an arm with {joints} joints, and the file's robot "
            f"'{program.context.loaded.task.robot.model}' has {n}"
        )
    known = {stage.name for stage in program.stages}
    for visit in history.visits():
        if visit.stage not in known:
            raise InputError(
                f"{name} has a stage '{visit.stage}', which the file does not; name the file that "
                f"it is a log of (its stages: {', '.join(known)})"
            )
