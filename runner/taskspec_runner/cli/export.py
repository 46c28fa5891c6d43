"""`taskspec export`: the log of a run for other tools."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import typer

from taskspec_runner.cli.options import TaskOptions
from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.errors import InputError

T = TypeVar("T")


def export_controller(
    file: Path, folder: Path, given: TaskOptions, forms: Sequence[str] = ()
) -> int:
    """Writes a task's controller as C and says where, and how it is compiled.

    Args:
        file: the task file.
        folder: to write into.
        given: what the task is changed by.
        forms: formats of logs, of which a task has none.

    Raises:
        SpecError: the task is refused.
        InputError: the file is no task, or the folder cannot be written.
    """
    _require_task(file, "--c", forms)
    from taskspec_runner.cli.run import admitted
    from taskspec_runner.controller_c.source import controller_of

    made = controller_of(admitted(file, given, force=False))
    header, source = _written(made.write, folder)
    typer.echo(f"{header}\n{source}")
    library = folder / f"{made.name}.so"
    typer.echo(f"compile it: cc -std=c99 -O2 -shared -fPIC {source} -o {library} -lm")
    typer.echo(f"judge it:   taskspec run {file} --on lib:{library}")
    return 0


def export_ros_package(
    file: Path, folder: Path, given: TaskOptions, forms: Sequence[str] = ()
) -> int:
    """Writes a task's controller as a package of ROS 2 and says where, and how it is built.

    Args:
        file, folder, given, forms: as of `export_controller`.

    Raises:
        SpecError: the task is refused.
        InputError: the file is no task, or the folder cannot be written.
    """
    _require_task(file, "--ros2-control", forms)
    from taskspec_runner.cli.run import admitted
    from taskspec_runner.ros2_control.package import package_of

    made = package_of(admitted(file, given, force=False))
    for path in _written(made.write, folder):
        if path.suffix != ".stl":
            typer.echo(str(path))
    typer.echo(f"build it:  colcon build --packages-select {made.name}")
    typer.echo(f"launch it: ros2 launch {made.name} mujoco.launch.py")
    typer.echo(f"read what its interfaces mean before it moves a robot: {folder / 'README.md'}")
    return 0


def _require_task(file: Path, option: str, forms: Sequence[str]) -> None:
    """Refuses what is no task file, and formats of logs beside `option`."""
    if forms:
        raise InputError(f"--{forms[0]} is of the log of a run, {option} of a task file; name one")
    if file.is_dir():
        raise InputError(f"{option} takes a task file, and {file} is a folder")


def _written(write: Callable[[Path], T], folder: Path) -> T:
    try:
        return write(folder)
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror or error}") from error


def export_log(
    folder: Path,
    path: Path | None,
    forms: Sequence[str],
    start: float | None = None,
    end: float | None = None,
) -> int:
    """Writes the log of a run in some formats and says where, and whether the run is partial."""
    if not forms:
        raise InputError(
            "name a format to export to: --csv, --parquet, --mcap or --rerun; "
            "or --c or --ros2-control for a task"
        )
    if path is not None and len(forms) > 1:
        raise InputError(f"{path} can hold one format, not {len(forms)}; leave the path out")
    from taskspec_runner.export import export_run
    from taskspec_runner.runs import Run

    run = Run.load(folder)

    for form in forms:
        done = export_run(run, form, path, start, end)
        typer.echo(str(done.path))
        if done.layout is not None:
            typer.echo(str(done.layout))
        if done.note:
            typer.echo(f"taskspec: {done.path} is {done.note}", err=True)
    return warn_of_damage(run, "what was exported")
