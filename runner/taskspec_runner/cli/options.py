"""Options of commands: those of several, and dataclasses of those that belong together.

A field's `help` says what it is, its default is that of the option: see `command.flattened`.
"""

from __future__ import annotations

from dataclasses import field
from pathlib import Path
from typing import Annotated

import typer

from taskspec.deferred_methods import dataclass
from taskspec_runner.cli import completions
from taskspec_runner.cli.formats import OutcomeFormat, RunFormat

TaskFile = Annotated[
    Path, typer.Argument(metavar="FILE", help="The task file; - is standard input.")
]
RunFolder = Annotated[Path, typer.Argument(metavar="RUN", help="The folder of a run.")]
Sets = Annotated[
    list[str],
    typer.Option("--set", metavar="KEY=VALUE", help="Override a value; may be repeated."),
]
NoCache = Annotated[
    bool,
    typer.Option("--no-cache", help="Examine anew, also what has not changed since the last time."),
]
Seed = Annotated[int, typer.Option(min=0, help="Of everything random.")]
StopAfter = Annotated[
    int, typer.Option(min=0, help="At the wall clock, stop when more in a row are lost.")
]
Force = Annotated[
    bool, typer.Option("--force", help="Run in spite of errors behind which the task compiles.")
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say only what failed.")]
Outcome = Annotated[RunFormat, typer.Option("--format", help="Of the outcome.")]
From = Annotated[
    float | None, typer.Option("--from", metavar="S", help="Begin at this run time in seconds.")
]
To = Annotated[
    float | None, typer.Option("--to", metavar="S", help="End at this run time in seconds.")
]


@dataclass(frozen=True)
class OverrideOptions:
    """What a task file is changed by, as `KEY=VALUE`."""

    sets: Sets = field(default_factory=list)


@dataclass(frozen=True)
class TaskOptions(OverrideOptions):
    """The same, and a law for every stage."""

    law: Annotated[
        str | None,
        typer.Option(
            help="Put every stage under this law, its gains designed.",
            autocompletion=completions.laws,
        ),
    ] = None


@dataclass(frozen=True)
class SeededOptions(TaskOptions):
    """The same with the seed of its runs."""

    seed: Seed = 0


@dataclass(frozen=True)
class WorldOptions(SeededOptions):
    """The same in one of its worlds."""

    world: Annotated[
        str | None,
        typer.Option(
            metavar="N|TABLE:ROW",
            help="A random world of 'vary' by its number under the seed, or a row of a sweep's "
            "table.",
            show_default="the true one",
        ),
    ] = None


@dataclass(frozen=True)
class ValidateOptions(WorldOptions):
    """How files are validated."""

    static: Annotated[
        bool, typer.Option("--static", help="Rules alone, without a trial: for editors.")
    ] = False
    worlds: Annotated[
        int, typer.Option(min=0, metavar="N", help="Try N random worlds of `vary` as well.")
    ] = 0


@dataclass(frozen=True)
class RecordOptions:
    """What a run leaves, and what is reported of it."""

    out: Annotated[
        Path | None,
        typer.Option(
            help="The run's folder; an earlier run in it is replaced.", show_default="runs/NAME"
        ),
    ] = None
    telemetry: Annotated[
        str | None,
        typer.Option(
            metavar="udp://HOST:PORT",
            help="Send signals as JSON while it runs, 100 times a simulated second or ?rate=HZ.",
        ),
    ] = None
    quiet: Quiet = False
    form: Annotated[OutcomeFormat, typer.Option("--format", help="Of the outcome.")] = (
        OutcomeFormat.TEXT
    )


@dataclass(frozen=True)
class RobotOptions:
    """The robot that a run is to be on, where there is one."""

    on: Annotated[
        str | None,
        typer.Option(
            "--on",
            metavar="udp://HOST:PORT",
            help="Run on a robot, or on the plant that 'taskspec plant' serves; judged as "
            "measured.",
        ),
    ] = None
    lost: Annotated[
        str,
        typer.Option(
            metavar="catch-up|hold",
            help="With --on, of a lost sample: a tick on the one before, or the task's time "
            "stands.",
        ),
    ] = "catch-up"
    stop_after: StopAfter = 20


@dataclass(frozen=True)
class PlantOptions:
    """How a plant is served."""

    listen: Annotated[
        str, typer.Option(metavar="udp://HOST:PORT", help="Where; port 0 is any that is free.")
    ] = "udp://127.0.0.1:39017"
    free_running: Annotated[
        bool, typer.Option("--free-running", help="At the wall clock; else wait for each answer.")
    ] = False
    stop_after: StopAfter = 20
    wait: Annotated[
        float, typer.Option(min=0, metavar="S", help="How long to wait for a controller.")
    ] = 600.0
    answer: Annotated[
        float, typer.Option(min=0.1, metavar="S", help="In lock-step, how long for an answer.")
    ] = 2.0
    open: Annotated[
        bool, typer.Option("--open", help="Listen where other machines may reach it.")
    ] = False


@dataclass(frozen=True)
class SweepOptions:
    """Which worlds a sweep runs, by whom, and what it leaves."""

    worlds: Annotated[
        int | None,
        typer.Option(min=1, help="Random worlds of 'vary'.", show_default="the file's, else 100"),
    ] = None
    corners: Annotated[
        bool, typer.Option("--corners", help="Every end of what varies, with every other.")
    ] = False
    grid: Annotated[
        int | None, typer.Option(min=2, metavar="N", help="N values of each that varies.")
    ] = None
    sets: Sets = field(default_factory=list)
    seed: Seed = 0
    jobs: Annotated[
        int | None,
        typer.Option("--jobs", "-j", min=1, help="At once.", show_default="the processors"),
    ] = None
    executor: Annotated[
        str | None,
        typer.Option(
            metavar="dask[:tcp://HOST:PORT]",
            help="A cluster of Dask: one of this machine, or that of a scheduler.",
            show_default="processes",
        ),
    ] = None
    shard: Annotated[
        str | None, typer.Option(metavar="I/N", help="Run one share of the worlds.")
    ] = None
    merge: Annotated[bool, typer.Option("--merge", help="Put folders of shares together.")] = False
    keep: Annotated[
        str,
        typer.Option(
            metavar="none|worst|failed|all|N,N", help="Worlds of which log and report are kept."
        ),
    ] = "worst"
    out: Annotated[
        Path | None,
        typer.Option(
            help="The sweep's folder; the same sweep in it is continued.",
            show_default="runs/NAME-sweep",
        ),
    ] = None
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Say only the verdict.")] = False
    form: Outcome = RunFormat.TEXT
    force: Force = False


@dataclass(frozen=True)
class CompareOptions:
    """Which laws are compared, and what that leaves."""

    law: Annotated[
        list[str] | None,
        typer.Option(
            help="A law to compare, its gains designed; may be repeated.",
            show_default="every law",
            autocompletion=completions.laws,
        ),
    ] = None
    sets: Sets = field(default_factory=list)
    seed: Seed = 0
    out: Annotated[
        Path | None,
        typer.Option(
            help="The comparison's folder; an earlier one in it is replaced.",
            show_default="runs/NAME-compare",
        ),
    ] = None
    quiet: Quiet = False
    form: Outcome = RunFormat.TEXT


@dataclass(frozen=True)
class ChoiceOptions:
    """Which files are tested, and in which order."""

    words: Annotated[
        str | None,
        typer.Option(
            "-k", metavar="WORDS", help="Files whose paths have these: 'press and not (qp or pd)'."
        ),
    ] = None
    jobs: Annotated[
        int,
        typer.Option(
            "--jobs", "-j", min=0, help="Processes.", show_default="one for each processor"
        ),
    ] = 0
    last_failed: Annotated[
        bool, typer.Option("--last-failed", "--lf", help="Those that failed the last time.")
    ] = False
    failed_first: Annotated[bool, typer.Option("--failed-first", "--ff", help="Those first.")] = (
        False
    )
    exit_first: Annotated[
        bool, typer.Option("--exitfirst", "-x", help="End at the first one that fails.")
    ] = False


@dataclass(frozen=True)
class ReportOptions:
    """How outcomes of tests are reported, and what is kept of them."""

    durations: Annotated[
        int, typer.Option(min=0, metavar="N", help="Name the N slowest files.")
    ] = 0
    junit: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the outcomes as JUnit XML too.")
    ] = None
    form: Annotated[OutcomeFormat, typer.Option("--format", help="Of the outcomes.")] = (
        OutcomeFormat.TEXT
    )
    out: Annotated[Path, typer.Option(help="Keeps the runs that failed, and what failed.")] = Path(
        "runs/tests"
    )
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep the runs that passed, too, with their reports.")
    ] = False
    quiet: Quiet = False


@dataclass(frozen=True)
class CutOptions:
    """What of a run a video or a window shows, and how."""

    speed: Annotated[
        float, typer.Option(help="1 is real time, 2 twice as fast, 0.25 a quarter.")
    ] = 1.0
    start: From = None
    end: To = None
    size: Annotated[str, typer.Option(metavar="WxH", help="Of the video, in pixels.")] = "1280x720"
    fps: Annotated[float, typer.Option(help="Frames in a second of the video.")] = 25.0
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="AZIMUTH,ELEVATION,DISTANCE",
            help="Look at the arm from here, in degrees and metres, such as 120,-20,1.2.",
            show_default="found for each run",
        ),
    ] = None
