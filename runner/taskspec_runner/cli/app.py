"""Commands and their options. What a command does is imported when it is called."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from taskspec_runner.cli import completions, options
from taskspec_runner.cli.formats import DiagnosticFormat, LoopName, OutcomeFormat, RunFormat
from taskspec_runner.cli.guard import guarded


def _made() -> typer.Typer:
    return typer.Typer(
        name="taskspec",
        help="Tasks in contact: written as text, checked before anything moves, run in simulation.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
    )


app = _made()


def _version(chosen: bool) -> None:
    if chosen:
        from taskspec import __version__

        typer.echo(f"taskspec {__version__}")
        raise typer.Exit


@app.callback()
def _taskspec(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say the version.")
    ] = False,
) -> None:
    """Tasks in contact: written as text, checked before anything moves, run in simulation."""


@app.command()
@guarded
def run(
    file: options.TaskFile,
    set_: options.Overrides = None,
    law: options.Law = None,
    seed: options.Seed = 0,
    world: options.World = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The run's folder; an earlier run in it is replaced.", show_default="runs/NAME"
        ),
    ] = None,
    telemetry: options.Telemetry = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say only what failed.")] = False,
    form: Annotated[
        OutcomeFormat, typer.Option("--format", help="Of the outcome.")
    ] = OutcomeFormat.TEXT,
    video: options.RunVideo = None,
    force: options.Force = False,
    loop: Annotated[
        LoopName, typer.Option(help="Machine code where there is some, or one of the two.")
    ] = LoopName.AUTO,
    on: options.On = None,
    lost: options.Lost = "catch-up",
    stop_after: options.StopAfter = 20,
) -> int:
    """Run a task in simulation, record it and judge what it expects."""
    from taskspec_runner.cli.run import Connection, run_task

    return run_task(
        file,
        set_ or [],
        law,
        seed,
        out,
        telemetry,
        quiet=quiet,
        form=form,
        video=video,
        force=force,
        loop=None if loop is LoopName.AUTO else loop.value,
        world=world,
        on=None if on is None else Connection(on, lost, stop_after),
    )


@app.command()
@guarded
def plant(
    file: options.TaskFile,
    listen: Annotated[
        str, typer.Option(metavar="udp://HOST:PORT", help="Where; port 0 is any that is free.")
    ] = "udp://127.0.0.1:39017",
    free_running: Annotated[
        bool, typer.Option("--free-running", help="At the wall clock; else wait for each answer.")
    ] = False,
    stop_after: options.StopAfter = 20,
    wait: Annotated[
        float, typer.Option(min=0, metavar="S", help="How long to wait for a controller.")
    ] = 600.0,
    answer: Annotated[
        float, typer.Option(min=0.1, metavar="S", help="In lock-step, how long for an answer.")
    ] = 2.0,
    open_: Annotated[
        bool, typer.Option("--open", help="Listen where other machines may reach it.")
    ] = False,
    set_: options.Overrides = None,
    law: options.Law = None,
    seed: options.Seed = 0,
    world: options.World = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The run's folder; an earlier run in it is replaced.", show_default="runs/NAME"
        ),
    ] = None,
    telemetry: options.Telemetry = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say only what failed.")] = False,
    form: Annotated[
        OutcomeFormat, typer.Option("--format", help="Of the outcome.")
    ] = OutcomeFormat.TEXT,
    force: options.Force = False,
) -> int:
    """Serve a task's plant: whoever answers with torques drives it, and is judged by the file."""
    from taskspec_runner.cli.plant import Listening, serve_plant

    return serve_plant(
        file,
        set_ or [],
        law,
        Listening(listen, open_, free_running, stop_after, wait, answer),
        seed=seed,
        world=world,
        out=out,
        telemetry=telemetry,
        quiet=quiet,
        form=form,
        force=force,
    )


@app.command()
@guarded
def sweep(
    files: Annotated[
        list[Path], typer.Argument(metavar="FILE", help="The task file; with --merge folders.")
    ],
    worlds: Annotated[
        int | None,
        typer.Option(min=1, help="Random worlds of 'vary'.", show_default="the file's, else 100"),
    ] = None,
    corners: Annotated[
        bool, typer.Option("--corners", help="Every end of what varies, with every other.")
    ] = False,
    grid: Annotated[
        int | None, typer.Option(min=2, metavar="N", help="N values of each that varies.")
    ] = None,
    set_: options.Overrides = None,
    seed: options.Seed = 0,
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", min=1, help="At once.", show_default="the processors"),
    ] = None,
    executor: Annotated[
        str | None,
        typer.Option(
            metavar="dask[:tcp://HOST:PORT]",
            help="A cluster of Dask: one of this machine, or that of a scheduler.",
            show_default="processes",
        ),
    ] = None,
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Run one share of the worlds.")
    ] = None,
    merge: Annotated[bool, typer.Option("--merge", help="Put folders of shares together.")] = False,
    keep: Annotated[
        str,
        typer.Option(
            metavar="none|worst|failed|all|N,N", help="Worlds of which log and report are kept."
        ),
    ] = "worst",
    out: Annotated[
        Path | None,
        typer.Option(
            help="The sweep's folder; the same sweep in it is continued.",
            show_default="runs/NAME-sweep",
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say only the verdict.")] = False,
    form: Annotated[RunFormat, typer.Option("--format", help="Of the outcome.")] = RunFormat.TEXT,
    force: options.Force = False,
) -> int:
    """Run a task in many worlds of its 'vary': how likely it succeeds, and on what that depends."""
    from taskspec_runner.cli.sweep import merge_parts, sweep_task

    if merge:
        return merge_parts(files, out, quiet=quiet, form=form)
    if len(files) != 1:
        raise typer.BadParameter("a sweep is of one task file; folders go with --merge")
    return sweep_task(
        files[0],
        set_ or [],
        seed,
        worlds,
        out,
        corners=corners,
        grid=grid,
        jobs=jobs,
        executor=executor,
        shard=shard,
        keep=keep,
        quiet=quiet,
        form=form,
        force=force,
    )


@app.command()
@guarded
def compare(
    file: options.TaskFile,
    law: Annotated[
        list[str] | None,
        typer.Option(
            help="A law to compare, its gains designed; may be repeated.",
            show_default="every law",
            autocompletion=completions.laws,
        ),
    ] = None,
    set_: options.Overrides = None,
    seed: options.Seed = 0,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The comparison's folder; an earlier one in it is replaced.",
            show_default="runs/NAME-compare",
        ),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say only what failed.")] = False,
    form: Annotated[RunFormat, typer.Option("--format", help="Of the outcome.")] = RunFormat.TEXT,
) -> int:
    """Run a task under several laws: one table and one picture, and which law cannot and why."""
    from taskspec_runner.cli.compare import compare_laws

    return compare_laws(file, set_ or [], law, seed, out, quiet=quiet, form=form)


@app.command()
@guarded
def validate(
    paths: Annotated[
        list[Path],
        typer.Argument(metavar="PATH...", help="Task files, or folders of them; - reads one."),
    ],
    set_: options.Overrides = None,
    law: options.Law = None,
    world: options.World = None,
    seed: options.Seed = 0,
    form: Annotated[
        DiagnosticFormat, typer.Option("--format", help="Of the findings.")
    ] = DiagnosticFormat.FULL,
    strict: Annotated[bool, typer.Option("--strict", help="Warnings fail as errors do.")] = False,
    select: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CODES", help="Only codes that begin so, such as TS2,TS301; may be repeated."
        ),
    ] = None,
    ignore: Annotated[
        list[str] | None,
        typer.Option(metavar="CODES", help="Leave these out, such as TS304 or TS3; as --select."),
    ] = None,
    static: Annotated[
        bool, typer.Option("--static", help="Rules alone, without a trial: for editors.")
    ] = False,
    worlds: Annotated[
        int, typer.Option(min=0, metavar="N", help="Try N random worlds of `vary` as well.")
    ] = 0,
    no_cache: options.NoCache = False,
) -> int:
    """Find what is wrong with task files: by rules, and by a trial of each."""
    from taskspec_runner.cli.validate import Examining, validate_paths

    return validate_paths(
        paths,
        form,
        strict=strict,
        select=select or (),
        ignore=ignore or (),
        how=Examining(tuple(set_ or ()), law, world, seed, static, worlds),
        keeps=not no_cache,
    )


@app.command("test")
@guarded
def run_tests_of(
    paths: Annotated[
        list[Path], typer.Argument(metavar="PATH...", help="Task files, or folders of them.")
    ],
    words: Annotated[
        str | None,
        typer.Option(
            "-k", metavar="WORDS", help="Files whose paths have these: 'press and not (qp or pd)'."
        ),
    ] = None,
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs", "-j", min=0, help="Processes.", show_default="one for each processor"
        ),
    ] = 0,
    last_failed: Annotated[
        bool, typer.Option("--last-failed", "--lf", help="Those that failed the last time.")
    ] = False,
    failed_first: Annotated[
        bool, typer.Option("--failed-first", "--ff", help="Those first.")
    ] = False,
    exit_first: Annotated[
        bool, typer.Option("--exitfirst", "-x", help="End at the first one that fails.")
    ] = False,
    durations: Annotated[
        int, typer.Option(min=0, metavar="N", help="Name the N slowest files.")
    ] = 0,
    junit: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the outcomes as JUnit XML too.")
    ] = None,
    form: Annotated[
        OutcomeFormat, typer.Option("--format", help="Of the outcomes.")
    ] = OutcomeFormat.TEXT,
    set_: options.Overrides = None,
    law: options.Law = None,
    seed: options.Seed = 0,
    out: Annotated[Path, typer.Option(help="Keeps the runs that failed, and what failed.")] = Path(
        "runs/tests"
    ),
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep the runs that passed, too, with their reports.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say only what failed.")] = False,
) -> int:
    """Run task files as tests: every expectation is a case."""
    from taskspec_runner.cli.test import ChosenFiles, Telling, run_tests

    return run_tests(
        paths,
        ChosenFiles(words, last_failed, failed_first, exit_first),
        Telling(form, junit, durations, quiet),
        jobs=jobs,
        out=out,
        keep=keep,
        sets=set_ or (),
        law=law,
        seed=seed,
    )


@app.command()
@guarded
def explain(
    what: Annotated[
        str,
        typer.Argument(
            metavar="FILE|CODE",
            help="A task file, - for standard input, or a code such as TS203.",
            autocompletion=completions.codes,
        ),
    ],
    set_: options.Overrides = None,
    law: options.Law = None,
    form: Annotated[
        RunFormat, typer.Option("--format", help="Of the explanation.")
    ] = RunFormat.TEXT,
    static: Annotated[
        bool, typer.Option("--static", help="Leave out the trial: what the plan tells alone.")
    ] = False,
) -> int:
    """Say what a task makes of itself and comes to in a trial; or what a code means."""
    from taskspec_runner.cli.explain import explain_what

    return explain_what(what, set_ or [], law, form, static=static)


@app.command()
@guarded
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


@app.command()
@guarded
def robots() -> int:
    """List the built-in robots, and those of installed packages."""
    from taskspec_runner.cli.robots import list_robots

    return list_robots()


@app.command()
@guarded
def new(
    template: Annotated[
        str | None,
        typer.Argument(
            metavar="TEMPLATE",
            help="A template; none lists them.",
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
        str | None, typer.Option(metavar="BODY", help="With --model: what carries the tool.")
    ] = None,
) -> int:
    """Begin a task of your own from a template, or for a robot of your own."""
    from taskspec_runner.cli.new import new_task

    return new_task(template, out, model, flange)


@app.command()
@guarded
def report(
    folder: Annotated[
        Path,
        typer.Argument(metavar="RUN", help="The folder of a run, of a comparison or of a sweep."),
    ],
) -> int:
    """Render the report of a run, or the page of a comparison or a sweep, again."""
    from taskspec_runner.cli.report import render_report

    return render_report(folder)


@app.command()
@guarded
def judge(
    what: Annotated[
        Path, typer.Argument(metavar="RUN|FILE", help="The folder of a run; or a task file.")
    ],
    log: Annotated[
        Path | None,
        typer.Argument(
            metavar="LOG",
            help="What was recorded elsewhere, to be judged by the file: CSV, Parquet or MCAP.",
            show_default="the run's own",
        ),
    ] = None,
    columns: Annotated[
        Path | None,
        typer.Option(
            metavar="MAP", help="Which of its columns is which signal, in which unit (YAML)."
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="The folder with summary and report; an earlier run in it is replaced.",
            show_default="runs/NAME-measured",
        ),
    ] = None,
    set_: options.Overrides = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say only what failed.")] = False,
    form: Annotated[RunFormat, typer.Option("--format", help="Of the judgement.")] = RunFormat.TEXT,
) -> int:
    """Judge a run again from its log; or judge what was recorded elsewhere by a task file."""
    from taskspec_runner.cli.judge import judge_folder, judge_log

    if log is None:
        return judge_folder(what, form, recorded=bool(columns or out or set_))
    return judge_log(what, log, columns, out, set_ or [], form, quiet=quiet)


@app.command()
@guarded
def export(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run.")],
    path: Annotated[
        Path | None,
        typer.Argument(metavar="PATH", help="The file.", show_default="RUN/log.FORMAT"),
    ] = None,
    csv: Annotated[bool, typer.Option("--csv", help="Text, units in the header.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Columns, units as metadata.")] = False,
    mcap: Annotated[
        bool, typer.Option("--mcap", help="ROS 2 messages for Foxglove and PlotJuggler.")
    ] = False,
    rerun: Annotated[bool, typer.Option("--rerun", help="A Rerun recording.")] = False,
    start: options.From = None,
    end: options.To = None,
) -> int:
    """Write the log of a run for other tools; of a killed run, what there is."""
    from taskspec_runner.cli.export import export_log

    chosen = {"csv": csv, "parquet": parquet, "mcap": mcap, "rerun": rerun}
    return export_log(folder, path, [form for form, wanted in chosen.items() if wanted], start, end)


@app.command()
@guarded
def diff(
    a: Annotated[Path, typer.Argument(metavar="RUN_A", help="The folder of a run.")],
    b: Annotated[Path, typer.Argument(metavar="RUN_B", help="The run that is held against it.")],
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a page with both in its charts.")
    ] = None,
    form: Annotated[
        RunFormat, typer.Option("--format", help="Of the difference.")
    ] = RunFormat.TEXT,
) -> int:
    """Say how two runs differ, and the first tick at which their logs part; exit 1 if they do."""
    from taskspec_runner.cli.diff import diff_folders

    return diff_folders(a, b, html, form)


@app.command()
@guarded
def replay(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run.")],
    video: options.Video = None,
    view: options.View = False,
    speed: options.Speed = 1.0,
    start: options.From = None,
    end: options.To = None,
    size: options.Size = "1280x720",
    fps: options.Fps = 25.0,
    camera: options.Camera = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show no progress.")] = False,
) -> int:
    """Look at a run again: robot, forces, frame and paths, as a video or in a window."""
    from taskspec_runner.cli.replay import replay_run

    cut = (speed, start, end, size, fps, camera)
    return replay_run(folder, video, cut, view=view, quiet=quiet)


def narrowed(arguments: Sequence[str]) -> typer.Typer:
    """The commands that arguments may mean: one, where they begin with its name, else all.

    To make parameters of all of them takes as long as to read a file.
    """
    named = [
        each
        for each in app.registered_commands
        if arguments and arguments[0] == (each.name or getattr(each.callback, "__name__", ""))
    ]
    if not named:
        return app
    alone = _made()
    alone.registered_callback = app.registered_callback
    alone.registered_commands = named
    return alone
