"""`taskspec export`: the log of a run for other tools."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from taskspec_runner.cli.options import TaskOptions
from taskspec_runner.cli.run_damage import warn_of_damage
from taskspec_runner.errors import InputError

if TYPE_CHECKING:
    from taskspec.program.program import Program


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
    from taskspec_runner.controller_c.source import controller_of

    made = controller_of(_program(file, "--c", given, forms))
    try:
        header, source = made.write(folder)
    except OSError as error:
        raise InputError(f"{folder} cannot be written: {error.strerror or error}") from error
    typer.echo(f"{header}\n{source}")
    library = folder / f"{made.name}.so"
    typer.echo(f"compile it: cc -std=c99 -O2 -shared -fPIC {source} -o {library} -lm")
    typer.echo(f"judge it:   taskspec run {file} --on lib:{library}")
    return 0


def export_fmu(
    file: Path, path: Path, fmi: int, given: TaskOptions, forms: Sequence[str] = ()
) -> int:
    """Writes a task's controller as an FMU and says where, and whether a binary is in it.

    Args:
        file: the task file.
        path: of the FMU, or a folder for one of the task's name.
        fmi: version of the interface, 2 or 3.
        given: what the task is changed by.
        forms: formats of logs, of which a task has none.

    Raises:
        SpecError: the task is refused.
        InputError: the file is no task, or the path cannot be written.
    """
    from taskspec_runner.controller_c.fmu import NoBinaryError, fmu_of

    made = fmu_of(_program(file, "--fmu", given, forms), fmi)
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
    typer.echo(f"judge it: taskspec run {file} --on fmu:{path}")
    if without:
        typer.echo(f"taskspec: {path} has no binary: {without}", err=True)
        typer.echo(f"compile it: fmpy compile {path}", err=True)
    return 0


def _program(file: Path, option: str, given: TaskOptions, forms: Sequence[str]) -> Program:
    """The program of a task that an option exports."""
    if forms:
        raise InputError(f"--{forms[0]} is of the log of a run, {option} of a task file; name one")
    if file.is_dir():
        raise InputError(f"{option} takes a task file, and {file} is a folder")
    from taskspec_runner.cli.run import admitted

    return admitted(file, given, force=False)


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
            "name a format to export to: --csv, --parquet, --mcap or --rerun; or --c for a task"
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
