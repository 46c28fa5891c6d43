"""`taskspec export`: the log of a run for other tools, the controller of a task as C."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from taskspec_runner.cli.options import DatasetOptions, TaskOptions
from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.errors import InputError

if TYPE_CHECKING:
    from taskspec.program.program import Program

T = TypeVar("T")

#: Options that take a task file.
OF_TASKS = "--c, --fmu, --ros2-control or --urscript"


def of_a_task(
    option: str, path: Path | None, forms: Sequence[str], start: float | None, end: float | None
) -> None:
    """Refuses with an option of a task file what is of the log of a run.

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


def of_all_ticks(forms: Sequence[str], start: float | None, end: float | None) -> None:
    """Refuses with a dataset what is of the log of one run.

    Raises:
        InputError: there is such a thing.
    """
    given = {f"--{form}": True for form in forms}
    given |= {"--from": start is not None, "--to": end is not None}
    wrong = [name for name, is_given in given.items() if is_given]
    if wrong:
        raise InputError(
            f"{wrong[0]} is of the log of one run, --lerobot of whole runs; leave one out"
        )


def of_a_dataset(given: DatasetOptions) -> None:
    """Refuses without a dataset what is of one.

    Raises:
        InputError: there is such a thing.
    """
    named = {"--fps": given.fps, "--camera": given.camera, "--size": given.size}
    wrong = [name for name, value in named.items() if value is not None]
    if wrong:
        raise InputError(f"{wrong[0]} is of a dataset; name its folder: --lerobot DIR")


def one_of(paths: Sequence[Path]) -> tuple[Path, Path | None]:
    """What is exported, and where to if that is named.

    Raises:
        InputError: more is named.
    """
    folder, *rest = paths
    if len(rest) > 1:
        raise InputError(
            f"{rest[1]} is one path too many: name a run and a file; --lerobot DIR takes many runs"
        )
    return folder, rest[0] if rest else None


def of_a_run(given: TaskOptions) -> None:
    """Refuses without an option of a task file what is of one.

    Raises:
        InputError: there is such a thing.
    """
    if given.sets or given.law is not None:
        wrong = "--set" if given.sets else "--law"
        raise InputError(f"{wrong} is of a task file, which {OF_TASKS} export; a log is as it is")


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
    from taskspec_runner.controller_c.source import controller_of

    made = controller_of(_program(file, "--c", given))
    header, source = _written(made.write, folder)
    library, name = folder / f"{made.name}.so", made.name
    sizes = [f"{path.stat().st_size / 1000:.0f} kB" for path in (header, source)]
    typer.echo(f"{header}  {sizes[0]}: what goes in and out, units, frames, signs and ends")
    typer.echo(f"{source}  {sizes[1]}; an instance takes {made.size} bytes, and no heap")
    typer.echo("Compile it as a library, and have it drive the plant of the file:")
    typer.echo(f"  cc -std=c99 -O2 -shared -fPIC {_word(source)} -o {_word(library)} -lm")
    typer.echo(f"  {_judging(file, given)} --on lib:{_word(library)}")
    typer.echo(f"Or call {name}_init, {name}_start and {name}_step in a program of your own.")
    return 0


def export_fmu(file: Path, path: Path, fmi: int, given: TaskOptions) -> int:
    """Writes a task's controller as an FMU and says where, and whether a binary is in it.

    Args:
        file: the task file.
        path: of the FMU, or a folder for one of the task's name.
        fmi: version of the interface, 2 or 3.
        given: what the task is changed by.

    Raises:
        SpecError: the task is refused.
        InputError: the file is no task, or the path cannot be written.
    """
    from taskspec_runner.controller_c.fmu import NoBinaryError, fmu_of

    made = fmu_of(_program(file, "--fmu", given), fmi)
    path = path if path.suffix == ".fmu" else path / f"{made.controller.name}.fmu"
    typer.echo("taskspec: compiling ...", err=True)
    binary, without = None, ""
    try:
        binary = made.binary()
    except NoBinaryError as error:
        without = str(error)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(made.to_bytes(binary))
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from error
    typer.echo(
        f"{path}\nFMI {fmi}.0, co-simulation: sources, {binary[0] if binary else 'no binary'}"
    )
    typer.echo(
        f"Have it drive the plant of the file: {_judging(file, given)} --on fmu:{_word(path)}"
    )
    if without:
        typer.echo(f"taskspec: {path} has no binary: {without}", err=True)
        typer.echo(f"compile it: fmpy compile {_word(path)}", err=True)
    return 0


def export_ros_package(file: Path, folder: Path, given: TaskOptions) -> int:
    """Writes a task's controller as a package of ROS 2 and says where, and how it is built.

    Args:
        file, folder, given: as of `export_controller`.

    Raises:
        SpecError: the task is refused.
        InputError: the file is no task, or the folder cannot be written.
    """
    from taskspec_runner.ros2_control.package import package_of

    made = package_of(_program(file, "--ros2-control", given))
    for path in _written(made.write, folder):
        if path.suffix != ".stl":
            typer.echo(str(path))
    typer.echo("Build and launch it in a workspace of ROS 2:")
    typer.echo(f"  colcon build --packages-select {made.name}")
    typer.echo(f"  ros2 launch {made.name} mujoco.launch.py")
    typer.echo(f"Read what its interfaces mean before it moves a robot: {folder / 'README.md'}")
    return 0


def export_urscript(file: Path, path: Path, given: TaskOptions) -> int:
    """Writes a task as a program of a Universal Robots arm, and says line by line what is lost.

    Args:
        file: the task file.
        path: of the program.
        given: what the task is changed by.

    Raises:
        SpecError: the task is refused.
        NotMappedError: it has no such program.
        InputError: the file is no task, or the path cannot be written.
    """
    from taskspec_runner.urscript.exported import script_of

    script = script_of(_program(file, "--urscript", given).plan)
    try:
        path.write_text(script.text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}") from error
    typer.echo(str(path))
    for loss in script.all_losses:
        typer.echo(f"{loss.source}:{loss.line}:{loss.column}: lost: {loss.text}")
    typer.echo("never executed, neither on a robot nor in URSim: read it, and adapt WORLD")
    return 0


def _written(write: Callable[[Path], T], folder: Path) -> T:
    """What `write` returns, which writes into a folder."""
    try:
        return write(folder)
    except OSError as error:
        why = "it is a file" if folder.is_file() else error.strerror or error
        raise InputError(f"{folder} cannot be written to: {why}; name a folder") from error


def _program(file: Path, option: str, given: TaskOptions) -> Program:
    """The program of a task that an option exports."""
    if file.is_dir():
        raise InputError(f"{option} takes a task file, and {file} is a folder")
    from taskspec_runner.cli.run import admitted

    return admitted(file, given, force=False)


def _judging(file: Path, given: TaskOptions) -> str:
    """The command that runs a task as it was exported."""
    sets = "".join(f" --set {shlex.quote(each)}" for each in given.sets)
    sets += "" if given.law is None else f" --law {given.law}"
    return f"taskspec run {_word(file)}{sets}"


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
            "name a format to export to: --csv, --parquet, --mcap, --rerun or --lerobot; "
            f"or {OF_TASKS} for a task"
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
