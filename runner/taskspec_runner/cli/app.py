"""Commands and their options. What a command does is imported when it is called."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from taskspec_runner.cli import completions, options
from taskspec_runner.cli.command import flattened
from taskspec_runner.cli.formats import DiagnosticFormat, LoopName, RunFormat
from taskspec_runner.cli.guard import guarded

app = typer.Typer(
    name="taskspec",
    help="Tasks in contact: written as text, checked before anything moves, run in simulation.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _command(function: Callable[..., int]) -> None:
    """Registers a command: its name, its options and its help are those of a function."""
    app.command()(guarded(flattened(function)))


def _version(chosen: bool) -> None:
    if chosen:
        from taskspec import __version__

        typer.echo(f"taskspec {__version__}")
        raise typer.Exit


@app.callback()
def _taskspec(
    context: typer.Context,
    version: Annotated[  # noqa: ARG001
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Tasks in contact: written as text, checked before anything moves, run in simulation."""
    from taskspec_runner.cli.diagnostics import forces_color

    if forces_color():
        context.color = True


@_command
def run(
    *,
    file: options.TaskFile,
    given: options.WorldOptions,
    kept: options.RecordOptions,
    video: Annotated[
        Path | None,
        typer.Option(metavar="OUT.MP4", help="Write a video of the run when it has ended."),
    ] = None,
    force: options.Force = False,
    loop: Annotated[
        LoopName,
        typer.Option(
            help="The loop that runs the ticks: machine code where it can, or one of the two."
        ),
    ] = LoopName.AUTO,
    live: options.LiveOptions,
    watched: options.WatchOptions,
    robot: options.RobotOptions,
) -> int:
    """Run a task in simulation, record it and judge what it expects."""
    from taskspec_runner.cli.run import Connection, run_task

    on = None if robot.on is None else Connection(robot.on, robot)
    by = None if loop is LoopName.AUTO else loop.value
    return run_task(
        file,
        given,
        kept,
        video=video,
        force=force,
        loop=by,
        on=on,
        live=live.moves,
        watched=watched,
    )


@_command
def plant(
    *,
    file: options.TaskFile,
    served: options.PlantOptions,
    given: options.WorldOptions,
    kept: options.RecordOptions,
    live: options.LiveOptions,
    force: options.Force = False,
) -> int:
    """Serve a task's plant: whoever answers with torques drives it, and is judged by the file."""
    from taskspec_runner.cli.plant import Listening
    from taskspec_runner.cli.run import run_task

    return run_task(file, given, kept, force=force, on=Listening(served), live=live.moves)


@_command
def sweep(
    *,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE", help="The task file; with --merge, the folders of the shares."
        ),
    ],
    sweeping: options.SweepOptions,
    watched: options.WatchOptions,
) -> int:
    """Run a task in many worlds of its 'vary': how likely it succeeds, and on what that depends."""
    from taskspec_runner.cli.sweep import merge_parts, sweep_task

    if sweeping.merge and watched.watch:
        raise typer.BadParameter("--watch shows a sweep that runs, and --merge runs none")
    if sweeping.merge:
        return merge_parts(files, sweeping)
    if len(files) != 1:
        raise typer.BadParameter("a sweep is of one task file; folders go with --merge")
    return sweep_task(files[0], sweeping, watched)


@_command
def tune(*, file: options.TaskFile, tuning: options.TuneOptions) -> int:
    """Find gains that succeed in every world that 'vary' allows, or the interval in the way."""
    from taskspec_runner.cli.tune import tune_task

    return tune_task(file, tuning)


@_command
def compare(*, file: options.TaskFile, comparing: options.CompareOptions) -> int:
    """Run a task under several laws: one table and one picture, and which law cannot and why."""
    from taskspec_runner.cli.compare import compare_laws

    return compare_laws(file, comparing)


@_command
def validate(
    *,
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="PATH...", help="Task files, or folders of them; - reads one."),
    ],
    how: options.ValidateOptions,
    form: Annotated[
        DiagnosticFormat, typer.Option("--format", help="The format of the findings.")
    ] = (DiagnosticFormat.FULL),
    strict: Annotated[bool, typer.Option("--strict", help="Warnings fail as errors do.")] = False,
    select: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CODES",
            help="Report only codes that begin so, such as TS2,TS301; may be repeated.",
        ),
    ] = None,
    ignore: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CODES",
            help="Leave out codes that begin so, such as TS304 or TS3; may be repeated.",
        ),
    ] = None,
    no_cache: options.NoCache = False,
    sarif: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write the findings to this file as SARIF, too."),
    ] = None,
) -> int:
    """Find what is wrong with task files: by rules, and by a trial of each."""
    from taskspec_runner.cli.validate import validate_paths

    only, but = select or (), ignore or ()
    return validate_paths(
        paths, form, how, strict=strict, select=only, ignore=but, keeps=not no_cache, sarif=sarif
    )


@_command
def test(
    *,
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Task files, or folders of them.")
    ],
    chosen: options.ChoiceOptions,
    reported: options.ReportOptions,
    given: options.SeededOptions,
) -> int:
    """Run task files as tests: every expectation is a case."""
    from taskspec_runner.cli.test import run_tests

    return run_tests(paths, chosen, reported, given)


@_command
def explain(
    *,
    what: Annotated[
        str,
        typer.Argument(
            metavar="FILE|CODE",
            help="A task file, - for standard input, or a code such as TS203.",
            autocompletion=completions.codes,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Argument(
            metavar="[PATH]",
            help="The file of --picture, .svg or .png; by default the name of the task with .svg.",
        ),
    ] = None,
    given: options.TaskOptions,
    picture: Annotated[
        bool,
        typer.Option(
            "--picture",
            help="Draw the start, the frames, who controls their axes, and the path instead.",
        ),
    ] = False,
    form: Annotated[RunFormat, typer.Option("--format", help="The format of the explanation.")] = (
        RunFormat.TEXT
    ),
    static: Annotated[
        bool,
        typer.Option("--static", help="Leave out the trial; show only what follows from the file."),
    ] = False,
    terms: Annotated[
        bool,
        typer.Option("--terms", help="Show inertia, gravity and Coriolis terms at the tool."),
    ] = False,
) -> int:
    """Say what a task makes of itself and comes to in a trial, or draw it; or what a code means."""
    from taskspec_runner.cli.explain import draw_task, explain_what

    if picture or out is not None:
        return draw_task(what, out, given.sets, given.law, form, wanted=picture, terms=terms)
    return explain_what(what, given.sets, given.law, form, static=static, terms=terms)


@_command
def schema(
    write: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Write it to this file or folder.")
    ] = None,
    check: Annotated[
        Path | None, typer.Option(metavar="PATH", help="Exit 1 unless this file is up to date.")
    ] = None,
) -> int:
    """Print the JSON Schema of task files, for editors."""
    from taskspec_runner.cli.schema import show_schema

    return show_schema(write, check)


@_command
def robots() -> int:
    """List the built-in robots, and those of installed packages."""
    from taskspec_runner.cli.robots import list_robots

    return list_robots()


@_command
def new(
    template: Annotated[
        str | None,
        typer.Argument(
            metavar="TEMPLATE",
            help="The template; without one the templates are listed.",
            autocompletion=completions.templates,
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="The new task file.", show_default="my-TEMPLATE.yaml")
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="ROBOT", help="Write a first task for this file, PACKAGE:NAME or built-in name."
        ),
    ] = None,
    flange: Annotated[
        str | None,
        typer.Option(metavar="BODY", help="With --model: the body that carries the tool."),
    ] = None,
) -> int:
    """Begin a task of your own from a template, or for a robot of your own."""
    from taskspec_runner.cli.new import new_task

    return new_task(template, out, model, flange)


@_command
def report(
    folder: Annotated[
        Path,
        typer.Argument(metavar="RUN", help="The folder of a run, of a comparison or of a sweep."),
    ],
) -> int:
    """Render the report of a run, or the page of a comparison or a sweep, again."""
    from taskspec_runner.cli.report import render_report

    return render_report(folder)


@_command
def judge(
    *,
    what: Annotated[
        Path | None,
        typer.Argument(
            metavar="RUN|FILE",
            help="The folder of a run; or a task file.",
            show_default=False,
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Argument(
            metavar="LOG",
            help="A log recorded elsewhere, to be judged by the file: CSV, Parquet or MCAP.",
            show_default="the run's own",
        ),
    ] = None,
    columns: Annotated[
        Path | None,
        typer.Option(
            metavar="MAP",
            help="The map of its columns to signals and units: a file (YAML), or the name "
            "of a ready map; 'list' prints those.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The folder with summary and report; an earlier run in it is replaced.",
            show_default="runs/NAME-measured",
        ),
    ] = None,
    given: options.OverrideOptions,
    quiet: options.Quiet = False,
    form: Annotated[
        RunFormat, typer.Option("--format", help="The format of the judgement.")
    ] = RunFormat.TEXT,
) -> int:
    """Judge a run again from its log; or judge what was recorded elsewhere by a task file."""
    from taskspec_runner.cli.judge import judge_folder, judge_log, list_maps

    if columns == Path("list") and what is None:
        return list_maps()
    if what is None:
        raise typer.BadParameter("name a run; or a task file and a log", param_hint="RUN|FILE")
    if log is None:
        return judge_folder(what, form, recorded=bool(columns or out or given.sets))
    return judge_log(what, log, columns, out, given.sets, form, quiet=quiet)


@_command
def identify(
    *,
    file: options.TaskFile,
    logs: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="LOG...",
            help="Folders of runs of the task; or logs recorded elsewhere: CSV, Parquet or MCAP. "
            "With --design there may be none.",
            show_default=False,
        ),
    ] = None,
    chosen: options.IdentifyOptions,
) -> int:
    """Identify stiffness, friction, place, payload, sensor and more from logs, with intervals."""
    if chosen.design is not None:
        from taskspec_runner.cli.identify_design import design_task

        return design_task(file, logs or [], chosen)
    if not logs:
        raise typer.BadParameter("name a log; or --design a task that makes one")
    from taskspec_runner.cli.identify import identify_task

    return identify_task(file, logs, chosen)


@_command
def export(
    *,
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN|FILE [PATH]",
            help="The folder of a run and the file that is written, by default RUN/log.FORMAT; "
            "with --lerobot folders of runs and sweeps; with --c, --fmu, --ros2-control or "
            "--urscript a task file.",
        ),
    ],
    csv: Annotated[
        bool, typer.Option("--csv", help="Write text, with units in the header.")
    ] = False,
    parquet: Annotated[
        bool, typer.Option("--parquet", help="Write columns, with units as metadata.")
    ] = False,
    mcap: Annotated[
        bool, typer.Option("--mcap", help="Write ROS 2 messages, for Foxglove and PlotJuggler.")
    ] = False,
    rerun: Annotated[bool, typer.Option("--rerun", help="Write a Rerun recording.")] = False,
    c: Annotated[
        Path | None,
        typer.Option(
            "--c",
            metavar="DIR",
            help="Write the controller of a task file as C99: NAME.h and NAME.c in a folder.",
        ),
    ] = None,
    fmu: Annotated[
        Path | None,
        typer.Option(
            "--fmu",
            metavar="PATH",
            help="Write it as an FMU for co-simulation: a file NAME.fmu, or a folder for one of "
            "the task's name.",
        ),
    ] = None,
    fmi: Annotated[
        int | None,
        typer.Option(
            "--fmi", min=2, max=3, metavar="2|3", help="The FMU's version of FMI, by default 3."
        ),
    ] = None,
    ros2_control: Annotated[
        Path | None,
        typer.Option(
            "--ros2-control", metavar="DIR", help="Write it as a ROS 2 package of ros2_control."
        ),
    ] = None,
    urscript: Annotated[
        Path | None,
        typer.Option(metavar="PATH", help="Write a task as a program of a Universal Robots arm."),
    ] = None,
    given: options.TaskOptions,
    dataset: options.DatasetOptions,
    start: options.From = None,
    end: options.To = None,
) -> int:
    """Write the log of a run for other tools, or a task for a robot's own controller."""
    from taskspec_runner.cli import export as exports

    chosen = {"csv": csv, "parquet": parquet, "mcap": mcap, "rerun": rerun}
    forms = [form for form, wanted in chosen.items() if wanted]
    named = {"--c": c, "--fmu": fmu, "--ros2-control": ros2_control, "--urscript": urscript}
    named["--lerobot"] = dataset.lerobot
    targets = [(option, target) for option, target in named.items() if target is not None]
    if len(targets) > 1:
        both = f"name one of {targets[0][0]} and {targets[1][0]}"
        raise typer.BadParameter(both, param_hint=targets[1][0])
    option, target = targets[0] if targets else ("", Path())
    if fmi is not None and option != "--fmu":
        raise typer.BadParameter("it is of an FMU; name one: --fmu PATH", param_hint="--fmi")
    if option == "--lerobot":
        from taskspec_runner.cli.dataset import export_episodes

        exports.of_a_run(given)
        exports.of_all_ticks(forms, start, end)
        return export_episodes(paths, target, dataset)
    exports.of_a_dataset(dataset)
    folder, path = exports.one_of(paths)
    if not targets:
        exports.of_a_run(given)
        return exports.export_log(folder, path, forms, start, end)
    exports.of_a_task(option, path, forms, start, end)
    if option == "--c":
        return exports.export_controller(folder, target, given)
    if option == "--fmu":
        return exports.export_fmu(folder, target, fmi or 3, given)
    if option == "--ros2-control":
        return exports.export_ros_package(folder, target, given)
    return exports.export_urscript(folder, target, given)


@_command
def runs(
    folder: Annotated[Path, typer.Argument(help="The folder of runs.")] = Path("runs"),
    most: Annotated[
        int, typer.Option("-n", min=1, metavar="N", help="List at most N folders.")
    ] = 30,
    html: Annotated[
        Path | None, typer.Option(help="Write a page with the trend of every task, too.")
    ] = None,
    form: Annotated[RunFormat, typer.Option("--format", help="The format of the list.")] = (
        RunFormat.TEXT
    ),
) -> int:
    """List runs, comparisons and sweeps, newest first, and since when a task misses."""
    from taskspec_runner.cli.runs import list_runs

    return list_runs(folder, html, form, most)


@_command
def lsp() -> int:
    """Serve an editor over the Language Server Protocol, on standard input and output."""
    from taskspec_runner.cli.lsp import serve

    return serve()


@_command
def diff(
    a: Annotated[Path, typer.Argument(metavar="RUN_A", help="The folder of a run.")],
    b: Annotated[
        Path, typer.Argument(metavar="RUN_B", help="The folder of the run to compare it with.")
    ],
    html: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write a page with both runs in its charts, too."),
    ] = None,
    form: Annotated[RunFormat, typer.Option("--format", help="The format of the difference.")] = (
        RunFormat.TEXT
    ),
) -> int:
    """Say how two runs differ, and the first tick at which their logs part; exit 1 if they do."""
    from taskspec_runner.cli.diff import diff_folders

    return diff_folders(a, b, html, form)


@_command
def replay(
    *,
    folder: options.RunFolder,
    video: Annotated[
        Path | None, typer.Option(metavar="OUT.MP4", help="Write a video; no screen is needed.")
    ] = None,
    shown: options.ReplayOptions,
    cut: options.CutOptions,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")] = False,
) -> int:
    """Look at a run again: robot, forces, frame and paths, as a video, in a page or a window."""
    from taskspec_runner.cli.replay import replay_run

    return replay_run(folder, video, cut, shown, quiet=quiet)
