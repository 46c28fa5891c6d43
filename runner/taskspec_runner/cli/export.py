"""`taskspec export`: the log of a run for other tools, the controller of a task as C."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import typer

from taskspec_runner.cli.options import TaskOptions
from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.errors import InputError

T = TypeVar("T")


def of_a_task(
    option: str, path: Path | None, forms: Sequence[str], start: float | None, end: float | None
) -> None:
    """Refuses with --c, or another option of a task file, what is of the log of a run.

    Raises:
        InputError: there is such a thing.
    """
    given = {f"--{form}": True for form in forms}
    given |= {"--from": start is not None, "--to": end is not None, str(path): path is not None}
    wrong = [name for name, is_given in given.items() if is_given]
    if wrong:
        raise InputError(
            f"{wrong[0]} is of the log of a run, {option} of a task file; leave one out"
        )


def of_a_run(given: TaskOptions) -> None:
    """Refuses without --c what is of a task file.

    Raises:
        InputError: there is such a thing.
    """
    if given.sets or given.law is not None:
        wrong = "--set" if given.sets else "--law"
        raise InputError(
            f"{wrong} is of a task file, which --c DIR and --ros2-control DIR export; "
            f"a log is as it is"
        )


def export_controller(file: Path, folder: Path, given: TaskOptions) -> int:
    """Writes a task's controller as C and says where, and how it is compiled.

    Args:
        file: the task file.
        folder: to write into.
        given: what the task is changed by.

    Raises:
        SpecError: the task is refused.
        InputError: the file is no task, or the folder cannot be written.
    """
    _require_file(file, "--c")
    from taskspec_runner.cli.run import admitted
    from taskspec_runner.controller_c.source import controller_of

    program = admitted(file, given, force=False)
    made = controller_of(program)
    header, source = _written(made.write, folder)
    library, name = folder / f"{made.name}.so", made.name
    sizes = [f"{path.stat().st_size / 1000:.0f} kB" for path in (header, source)]
    typer.echo(f"{header}  {sizes[0]}: what goes in and out, units, frames, signs and ends")
    typer.echo(f"{source}  {sizes[1]}; an instance takes {made.size} bytes, and no heap")
    typer.echo("Compile it as a library, and have it drive the plant of the file:")
    typer.echo(f"  cc -std=c99 -O2 -shared -fPIC {_word(source)} -o {_word(library)} -lm")
    sets = "".join(f" --set {shlex.quote(each)}" for each in given.sets)
    sets += "" if given.law is None else f" --law {given.law}"
    typer.echo(f"  taskspec run {_word(file)}{sets} --on lib:{_word(library)}")
    typer.echo(f"Or call {name}_init, {name}_start and {name}_step in a program of your own.")
    return 0


def export_ros_package(file: Path, folder: Path, given: TaskOptions) -> int:
    """Writes a task's controller as a package of ROS 2 and says where, and how it is built.

    Args:
        file, folder, given: as of `export_controller`.

    Raises:
        SpecError: the task is refused.
        InputError: the file is no task, or the folder cannot be written.
    """
    _require_file(file, "--ros2-control")
    from taskspec_runner.cli.run import admitted
    from taskspec_runner.ros2_control.package import package_of

    made = package_of(admitted(file, given, force=False))
    for path in _written(made.write, folder):
        if path.suffix != ".stl":
            typer.echo(str(path))
    typer.echo("Build and launch it in a workspace of ROS 2:")
    typer.echo(f"  colcon build --packages-select {made.name}")
    typer.echo(f"  ros2 launch {made.name} mujoco.launch.py")
    typer.echo(f"Read what its interfaces mean before it moves a robot: {folder / 'README.md'}")
    return 0


def _require_file(file: Path, option: str) -> None:
    if file.is_dir():
        raise InputError(f"{option} takes a task file, and {file} is a folder")


def _written(write: Callable[[Path], T], folder: Path) -> T:
    """What `write` returns, which writes into a folder."""
    try:
        return write(folder)
    except OSError as error:
        why = "it is a file" if folder.is_file() else error.strerror or error
        raise InputError(f"{folder} cannot be written to: {why}; name a folder") from error


def _word(path: Path) -> str:
    """A path as a word of a shell's command."""
    return shlex.quote(str(path))


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
